"""Everything that follows from the iteration alone: learning rate, resolution, order of the views."""

from __future__ import annotations

import math

from jaxtyping import Int
from numpy import ndarray

from instdrive_core.maths.streams import Stream, make_generator
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


def find_edge_start(config: TrainConfig) -> int:
    """Find the first step of the RGB stage that learns the masks' edges; nothing grows from there on."""
    share = max(config.geometry.edge_start, config.densify.stop)
    return math.ceil(share * config.geometry.iterations)


def choose_view(seed: int, stream: Stream, iteration: int, views: int) -> int:
    """Choose the view of a step. Each epoch visits every view once, in an order of its own.

    The choice depends on nothing but the arguments, so that a resumed run goes on as it would have.
    """
    epoch, position = divmod(iteration, views)
    order: Int[ndarray, " v"] = make_generator(seed, stream, epoch).permutation(views)
    return int(order[position])


def is_pseudo_supervised(config: TrainConfig, iteration: int) -> bool:
    """Pseudo supervision begins after its share of the stage that carries the instance losses."""
    instances = config.instances
    total = instances.iterations if instances.schedule == "after" else config.geometry.iterations
    return iteration >= instances.pseudo_start * total
