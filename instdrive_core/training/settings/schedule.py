"""What depends on the iteration alone: learning rate, resolution, order of the views, random numbers."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from instdrive_core.training.settings.config import GeometryConfig, TrainConfig

FINAL_MEANS_LR = 0.01
"""The means' learning rate falls to this share of its start."""


def compute_means_lr(config: GeometryConfig, iteration: int, scene_radius: float) -> float:
    """Log-linear decay over the stage (3DGS)."""
    progress = min(iteration / max(config.iterations - 1, 1), 1.0)
    return config.means_lr * scene_radius * FINAL_MEANS_LR**progress


def is_coarse(config: GeometryConfig, iteration: int) -> bool:
    """Whether a step runs at half the resolution."""
    return iteration < config.coarse_iterations


def choose_view(seed: int, stage: int, iteration: int, views: int) -> int:
    """Each epoch visits every view once in its own order: a function of the iteration, so that runs can resume."""
    epoch, position = divmod(iteration, views)
    order: Int[ndarray, " v"] = np.random.default_rng((seed, 1, stage, epoch)).permutation(views)
    return int(order[position])


def step_rng(seed: int, stage: int, iteration: int) -> np.random.Generator:
    """The random numbers of one step, independent of all steps before it."""
    return np.random.default_rng((seed, 2, stage, iteration))


def is_pseudo_supervised(config: TrainConfig, iteration: int) -> bool:
    """Pseudo supervision begins after its share of the stage that carries the instance losses."""
    instances = config.instances
    total = instances.iterations if instances.schedule == "after" else config.geometry.iterations
    return iteration >= instances.pseudo_start * total
