"""The first start on a machine compiles the kernels; later ones read them from Numba's cache. This says so and does it.

A child process compiles, so that the run itself always executes what the cache holds. The process that compiles a
parallel kernel may execute another version of it than it stores: calls are inlined in both, but vectorised separately,
and their sums can differ in the last bit. A run killed and resumed would then differ from one that went through.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import llvmlite.binding
import numba
import numpy as np

from instdrive_core.rasterize.kernels.fragment import power_of_two
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.track import Track
from instdrive_core.training.gaussians.model import build_model
from instdrive_core.training.settings.config import TrainConfig, build_train_config
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore

_SOURCES = Path(__file__).parents[1]
_MESSAGE = "compiling the kernels for this machine (once, about a minute; they are kept for later runs)"


def compile_kernels(on_note: Callable[[str], None]) -> None:
    """See that all kernels of a training step are compiled; returns at once where they are.

    Where compiling or keeping them fails (a folder that is not writable), each process compiles its own as it goes.
    """
    stamp = _stamp()
    if stamp.exists():
        return
    on_note(_MESSAGE)
    done = subprocess.run([sys.executable, "-m", __name__], capture_output=True, check=False)
    if done.returncode == 0:
        stamp.parent.mkdir(parents=True, exist_ok=True)
        stamp.touch()


def take_a_step_of_each_stage() -> None:
    """Train a scene of a few Gaussians: calls every kernel that a training step calls."""
    trainer = _small_trainer()
    trainer.rgb_step()
    trainer.stage = "instances"
    trainer.instance_step()


def _stamp() -> Path:
    """The file that tells that these sources' kernels are compiled for this machine; lies where Numba keeps them."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version} {llvmlite.binding.get_host_cpu_name()}".encode())
    for path in sorted(_SOURCES.rglob("*.py")):
        digest.update(f"{path} {path.stat().st_mtime_ns}".encode())
    folder = Path(power_of_two.stats.cache_path or _SOURCES)
    return folder / f"kernels-{digest.hexdigest()[:16]}.compiled"


def _small_trainer() -> Trainer:
    rng, count = np.random.default_rng(0), 64
    gaussians = Gaussians(
        means=rng.uniform([-2, 4, -1], [2, 8, 1], (count, 3)).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.full((count, 3), -1, np.float32),
        opacity_logits=np.zeros(count, np.float32),
        sh_dc=np.zeros((count, 3), np.float32),
        sh_rest=np.zeros((count, 3, 3), np.float32),
        features=rng.normal(0, 0.1, (count, 4)).astype(np.float32),
    )
    nodes = np.repeat(np.array([0, 1], np.uint16), count // 2)
    pose = np.eye(4)[None]
    track = Track("warm-up", "Car", np.array([2.0, 4.0, 2.0]), np.zeros(1), pose, True)
    model = build_model(gaussians, nodes, (track,), np.full((6, 4, 4, 3), 0.5, np.float32), (0.0,))
    return Trainer(model, ViewStore.from_views([_small_view()]), _small_config(), 10.0)


def _small_view() -> TrainingView:
    height, width = 32, 48
    camera = Camera(40.0, 40.0, 24.0, 16.0, width, height, look_at(np.zeros(3), np.array([0, 6.0, 0])))
    labels = np.repeat(np.arange(1, 3, dtype=np.uint16), width // 2)[None].repeat(height, axis=0)
    sky = np.zeros((height, width), bool)
    sky[:4] = True
    pixels = np.arange(200, 400, dtype=np.int32)
    return TrainingView(
        key="warm-up/00",
        camera=camera,
        time=0.0,
        image=np.full((height, width, 3), 128, np.uint8),
        valid=np.ones((height, width), bool),
        labels=np.ascontiguousarray(labels),
        sky=sky,
        depth_pixels=pixels,
        depth_values=np.full(len(pixels), 6, np.float32),
    )


def _small_config() -> TrainConfig:
    config = build_train_config()
    return replace(
        config,
        geometry=replace(config.geometry, coarse_iterations=0),
        instances=replace(config.instances, feature_dim=4, pixels_per_view=200),
    )


if __name__ == "__main__":
    take_a_step_of_each_stage()
