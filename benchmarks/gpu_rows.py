"""The rows of `benchmarks/gpu_check.sh`: `python -m benchmarks.gpu_rows NAME` prints one row's figures as JSON."""

from __future__ import annotations

import importlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.profiler import ProfilerActivity, profile

from benchmarks.gpu import build_config, finish_run, noise_view, peak_megabytes
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.track import Track
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.device import (
    choose_backend,
    describe_cuda_row,
    describe_gpu,
    explain_missing_cuda,
)
from instdrive_core.training.backends.torch_ops import photometric_loss
from instdrive_core.training.build_trainer import resume_trainer
from instdrive_core.training.checkpoint import load_checkpoint, save_checkpoint
from instdrive_core.training.gaussians.model import SceneModel, build_model
from instdrive_core.training.settings.schedule import compute_means_lr
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore

ROOT = Path(__file__).resolve().parents[1]
FROM_PYPI, FROM_SOURCE = "gsplat>=1.5.3", "git+https://github.com/nerfstudio-project/gsplat"
WAITS = ("cudaStreamSynchronize", "cudaEventSynchronize", "cudaMemcpyAsync", "cudaLaunchKernel")
"""What is counted for each step, by the profiler's names."""
RADIUS = 50.0
"""Metres, of the made-up scene."""
ACTORS, PHOTOS_PER_EYE = 20, 6
FULL_HD = (1920, 1080)


def describe_machine() -> dict[str, object]:
    """Versions and, in `no_gpu`, why training on a GPU is out of reach; missing gsplat is not among these reasons."""
    torch_lacks = torch.version.cuda is None or not torch.cuda.is_available()
    return {
        "python": platform.python_version(),
        "torch": torch.__version__,
        "cuda_of_torch": torch.version.cuda,
        "nvcc": _say(["nvcc", "--version"]),
        "driver": _say(["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]),
        "gpu": None if torch_lacks else describe_gpu(),
        "row_in_docs": describe_cuda_row(),
        "no_gpu": explain_missing_cuda() if torch_lacks else None,
    }


def _say(command: list[str]) -> str | None:
    """Last line that a program prints; None where it is missing or fails."""
    if shutil.which(command[0]) is None:
        return None
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=20)
    return None if result.returncode else result.stdout.strip().rpartition("\n")[2]


def describe_opengl() -> dict[str, object]:
    """What the editor would draw with, without a window."""
    from instdrive_app.render.frame_renderer import choose_renderer_kind
    from instdrive_app.render.offscreen import describe_driver, open_offscreen_context

    with open_offscreen_context() as context:
        renderer = context.info["GL_RENDERER"]
        return {
            "driver": describe_driver(context),
            "renderer": renderer,
            "version": context.info["GL_VERSION"],
            "largest_texture": context.info["GL_MAX_TEXTURE_SIZE"],
            "splats_drawn_by": choose_renderer_kind(renderer),
        }


def install_gsplat() -> dict[str, object]:
    """Take gsplat as it is, or put one into a folder of this check, from its source where torch is for CUDA 13."""
    lacking = explain_missing_cuda()
    if lacking is not None:
        source = FROM_SOURCE if str(torch.version.cuda).startswith("13.") else FROM_PYPI
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--target", os.environ["GPU_CHECK_SITE"]]
        # Without its kernels, which are compiled at first use, and without torch, which is there.
        built_later = {**os.environ, "BUILD_NO_CUDA": "1"}
        for more in (["--no-deps", "--no-build-isolation", source], ["--no-deps", "ninja"]):
            subprocess.run([*pip, *more], check=True, env=built_later, stdout=sys.stderr)
        importlib.invalidate_caches()
        sys.path.insert(0, os.environ["GPU_CHECK_SITE"])  # was no folder yet when this process began
        if (still := explain_missing_cuda()) is not None:
            raise SystemExit(still)
    gsplat: Any = importlib.import_module("gsplat")
    return {"gsplat": gsplat.__version__, "from": str(Path(gsplat.__file__).parent), "was_missing": lacking}


def build_kernels() -> dict[str, object]:
    """Compile gsplat's kernels and draw one Gaussian. Raises OptionError where that fails."""
    return {"device": str(choose_backend("cuda").device)}


def run_tests() -> dict[str, object]:
    """The tests that need a GPU; the row fails where one of them fails or was skipped."""
    command = [sys.executable, "-m", "pytest", "-m", "gpu", "-rs", "-p", "no:cacheprovider", "tests/training"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    print(result.stdout, file=sys.stderr)
    summary = (result.stdout.strip() or "pytest said nothing").splitlines()[-1]
    if result.returncode or "skipped" in summary:
        raise SystemExit(f"pytest -m gpu: {summary}")
    return {"pytest": summary}


def resume_run(backend: Backend, gaussians: int = 20_000, size: tuple[int, int] = (480, 270)) -> dict[str, object]:
    """A run of three steps, saved, resumed for a step, and gone on with on the CPU."""
    trainer = make_trainer(backend, gaussians, size)
    for _ in range(3):
        take_step(trainer)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checkpoint.safetensors"
        save_checkpoint(path, trainer)
        again = resume_trainer(trainer.config, trainer.store, path, load_checkpoint(path), backend)
    expected, found = take_step(trainer), take_step(again)
    for name, value in found.items():
        if not abs(value - expected[name]) <= 1e-2 * abs(expected[name]) + 1e-4:
            raise SystemExit(f"the resumed run's {name} loss is {value}, that of the run itself {expected[name]}")
    again.continue_on_cpu()
    return {"loss": sum(expected.values()), "loss_resumed": sum(found.values()), "goes_on": again.backend.name}


def measure_our_steps(
    backend: Backend, gaussians: int, size: tuple[int, int] = FULL_HD, steps: int = 20
) -> dict[str, object]:
    """InstDrive's own step: sky, exposures, 20 actors and all harmonics, without instance losses."""
    trainer = make_trainer(backend, gaussians, size)

    def step() -> None:
        trainer.rgb_step()
        trainer.iteration += 1
        if trainer.iteration % trainer.config.report_every == 0:
            trainer.read_losses()

    return {**measure_steps(step, trainer, steps), "photo": f"{size[0]}x{size[1]}"}


def take_step(trainer: Trainer) -> dict[str, float]:
    """One step of the RGB stage; returns its terms."""
    trainer.rgb_step()
    trainer.iteration += 1
    return trainer.read_losses().terms


def measure_gsplat_steps(
    backend: Backend, library: Any, gaussians: int, size: tuple[int, int] = FULL_HD, steps: int = 20
) -> dict[str, object]:
    """The step of gsplat's own trainer, examples/simple_trainer.py, on our scene and photos.

    Rebuilt, because that script is not in gsplat's package and wants photos of its own: `gsplat.rasterization`, not
    packed, L1 and SSIM as 0.8 to 0.2, and an Adam for each of six parameters, over all rows. The SSIM is ours.
    """
    trainer = make_trainer(backend, gaussians, size)
    model, views, config = trainer.model, list(map(trainer.store.get, range(len(trainer.store)))), trainer.config
    leaves = {name: value.clone().requires_grad_(True) for name, value in model.parameters.items()}
    leaves.pop("features")
    rates = {"means": compute_means_lr(config.geometry, 0, RADIUS), "opacity_logits": 5e-2, "log_scales": 5e-3}
    adams = [torch.optim.Adam([leaf], lr=rates.get(name, 2.5e-3), eps=1e-15) for name, leaf in leaves.items()]
    taken = 0

    def step() -> dict[str, float]:
        nonlocal taken
        view = views[taken % len(views)]
        image, _, _ = library.rasterization(
            leaves["means"],
            leaves["quats"],
            leaves["log_scales"].exp(),
            leaves["opacity_logits"].sigmoid(),
            torch.cat([leaves["sh_dc"][:, None], leaves["sh_rest"]], dim=1),
            torch.from_numpy(view.camera.camera_from_world).to(leaves["means"])[None],
            torch.from_numpy(view.camera.intrinsics).to(leaves["means"])[None],
            view.camera.width,
            view.camera.height,
            sh_degree=3,
            packed=False,
        )
        loss, _ = photometric_loss(image[0], view.image, None, 0.2)
        loss.backward()
        for adam in adams:
            adam.step()
            adam.zero_grad(set_to_none=True)
        taken += 1
        return {"rgb": float(loss.detach())}

    return {**measure_steps(step, trainer, steps), "photo": f"{size[0]}x{size[1]}", "gsplat": library.__version__}


def measure_steps(step: Callable[[], object], trainer: Trainer, steps: int) -> dict[str, object]:
    """Milliseconds a step, those that the GPU is busy in it, waits, copies and launches a step, and peak memory."""

    def go(count: int) -> float:
        start = finish_run(trainer)
        for _ in range(count):
            step()
        return (finish_run(trainer) - start) / count * 1e3

    on_gpu, profiled = trainer.backend.device.type == "cuda", 3
    go(max(steps // 4, 1))
    milliseconds, peak = go(steps), peak_megabytes(trainer.backend.device)
    activities = [ProfilerActivity.CPU, *([ProfilerActivity.CUDA] if on_gpu else [])]
    with profile(activities=activities) as profiler:
        go(profiled)
    events = profiler.key_averages()
    # An operation's own row repeats the time of the kernels that it starts.
    kernels = [event for event in events if event.device_type.name == "CUDA" and not event.is_user_annotation]
    slowest = sorted(kernels, key=lambda event: -event.self_device_time_total)[:12]
    counts = {name: sum(event.count for event in events if event.key == name) / profiled for name in WAITS}
    return {
        "ms_per_step": round(milliseconds, 2),
        "busy_ms_per_step": sum_device_milliseconds(kernels) / profiled if on_gpu else None,
        "calls_per_step": {name: round(count, 1) for name, count in counts.items()} if on_gpu else None,
        "peak_gpu_mb": peak,
        "gaussians": len(trainer.model),
        "kernels": {event.key[:60]: sum_device_milliseconds([event]) / profiled for event in slowest},
    }


def sum_device_milliseconds(events: list[Any]) -> float:
    """Milliseconds that the device worked on these rows of a profile."""
    return round(sum(event.self_device_time_total for event in events) / 1e3, 3)


def make_trainer(backend: Backend, gaussians: int, size: tuple[int, int]) -> Trainer:
    """A trainer on a made-up street of 80 m with photos of noise."""
    views = list_views(size)
    config = build_config(16, with_instances=False)
    config = replace(config, densify=replace(config.densify, max_gaussians=gaussians))
    trainer = Trainer(make_street(gaussians, len(views)), ViewStore.from_views(views, 1 << 34), config, RADIUS, backend)
    trainer.iteration = 1
    return trainer


def list_views(size: tuple[int, int]) -> list[TrainingView]:
    """Two rigs of six cameras that look all around."""
    width, height = size
    turns = np.linspace(0, 2 * np.pi, PHOTOS_PER_EYE, endpoint=False)
    poses = [
        look_at(np.array([x, 0.0, 1.5]), np.array([x + np.cos(turn), np.sin(turn), 1.4]))
        for x in (-20.0, 20.0)
        for turn in turns
    ]
    focal = width / 1.92
    return [
        noise_view(Camera(focal, focal, width / 2, height / 2, width, height, pose), number)
        for number, pose in enumerate(poses)
    ]


def make_street(count: int, photos: int) -> SceneModel:
    """Splats of 5 cm strewn over a flat street, 2 % of them in 20 actors."""
    rng = np.random.default_rng(0)

    def draw(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape, np.float32)

    gaussians = Gaussians(
        means=draw(count, 3) * np.array([40, 40, 2], np.float32),
        quats=draw(count, 4),
        log_scales=np.float32(-3) + np.float32(0.5) * draw(count, 3),
        opacity_logits=2 * draw(count),
        sh_dc=draw(count, 3),
        sh_rest=np.float32(0.1) * draw(count, 15, 3),
        features=np.zeros((count, 0), np.float32),
    )
    in_actors = count // 50
    nodes = np.zeros(count, np.uint16)
    nodes[count - in_actors :] = np.sort(rng.integers(1, ACTORS + 1, in_actors))
    size = np.array([2.0, 4.0, 2.0])
    tracks = tuple(
        Track(f"{number}", "Car", size, np.zeros(1), np.eye(4)[None], moving=True) for number in range(ACTORS)
    )
    return build_model(gaussians, nodes, tracks, np.full((6, 128, 128, 3), 0.5, np.float32), [0.0] * photos)


def _on_gpu(measure: Callable[..., dict[str, object]], *arguments: object) -> dict[str, object]:
    return measure(choose_backend("cuda"), *arguments)


def _beside_gsplat(gaussians: int) -> dict[str, object]:
    return measure_gsplat_steps(choose_backend("cuda"), importlib.import_module("gsplat"), gaussians)


ROWS: dict[str, Callable[[], dict[str, object]]] = {
    "machine": describe_machine,
    "opengl": describe_opengl,
    "install": install_gsplat,
    "build": build_kernels,
    "tests": run_tests,
    "resume": partial(_on_gpu, resume_run),
    "steps_1m": partial(_on_gpu, measure_our_steps, 1_000_000),
    "gsplat_1m": partial(_beside_gsplat, 1_000_000),
    "steps_5m": partial(_on_gpu, measure_our_steps, 5_000_000),
    "gsplat_5m": partial(_beside_gsplat, 5_000_000),
}

if __name__ == "__main__":
    began = time.perf_counter()
    figures = ROWS[sys.argv[1]]()
    print(json.dumps({**figures, "seconds_inside": round(time.perf_counter() - began, 1)}))
