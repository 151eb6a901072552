"""The trainer on a GPU, and on a stand-in for one: the same steps as on the CPU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drive import drive
from torch_splatting import GPU, backend_of

from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.backends.device import choose_backend, explain_missing_cuda
from instdrive_core.training.build_trainer import build_trainer_from_clip
from instdrive_core.training.settings.config import TrainConfig, build_train_config
from instdrive_core.training.settings.events import StepDone
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.view_store import open_view_store


def small_config(points: int, iterations: int) -> TrainConfig:
    config = build_train_config("instdrive", "demo", seed=1)
    return replace(
        config,
        init=replace(
            config.init, lidar_points=points, near_points=points // 8, far_points=points // 8, actor_points=20
        ),
        geometry=replace(config.geometry, iterations=iterations, coarse_iterations=2, sky_resolution=8),
        report_every=1,
    )


def trainer_on(backend: Backend, config: TrainConfig) -> Trainer:
    clip = drive()
    return build_trainer_from_clip(config, clip, open_view_store(clip, None), backend)


@pytest.mark.parametrize("kind", ["like 1.5", GPU])
def test_steps_train_as_on_the_cpu(kind: str) -> None:
    """The whole step: a moving actor with a learned track, sky, exposures, LiDAR depth, half resolution at first."""
    config = small_config(points=60, iterations=5)
    ours, theirs = trainer_on(backend_of(kind), config), trainer_on(CpuBackend(), config)
    assert ours.model.nodes.any()
    for _ in range(5):
        ours.rgb_step()
        theirs.rgb_step()
        found, expected = ours.read_losses(), theirs.read_losses()
        assert found.terms == pytest.approx(expected.terms, rel=0.02, abs=1e-4)
        assert found.psnr == pytest.approx(expected.psnr, abs=0.2)
        ours.iteration += 1
        theirs.iteration += 1


@pytest.mark.gpu
@pytest.mark.filterwarnings("default")  # of gsplat
def test_a_run_on_the_gpu_improves() -> None:
    missing = explain_missing_cuda()
    if missing is not None:
        pytest.skip(missing)
    trainer = trainer_on(choose_backend("cuda"), small_config(points=3000, iterations=300))
    steps = [event for event in trainer.run() if isinstance(event, StepDone)]
    first, last = (np.mean([step.psnr for step in part]) for part in (steps[:5], steps[-5:]))
    assert last > first + 3
