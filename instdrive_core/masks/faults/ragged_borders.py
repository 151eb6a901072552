"""Ragged borders: labels move by a few pixels, alike along a short stretch of border."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray


def shift_labels(labels: ndarray, shifts: Int64[ndarray, "2 h w"]) -> ndarray:
    """Give each pixel the label of the place that its shift leads to; beyond the edge, that of the edge."""
    height, width = labels.shape
    rows = np.clip(np.arange(height)[:, None] + shifts[0], 0, height - 1)
    columns = np.clip(np.arange(width)[None, :] + shifts[1], 0, width - 1)
    return labels[rows, columns]


def draw_border_shifts(
    height: int, width: int, ragged: float, grain: int, rng: np.random.Generator
) -> Int64[ndarray, "2 h w"]:
    """Draw whole pixels (row, column) by which to move, of length `ragged` at most, alike within `grain` pixels."""
    shape = (height // grain + 2, width // grain + 2)
    angle = rng.uniform(0, 2 * np.pi, shape)
    length = ragged * np.sqrt(rng.random(shape))  # evenly over a disc; between nodes it stays inside
    nodes = (length * np.stack([np.sin(angle), np.cos(angle)])).astype(np.float32)
    wanted = _interpolate(_interpolate(nodes, height, grain, 1), width, grain, 2)
    rounded = np.rint(wanted)
    too_far = (rounded**2).sum(axis=0) > ragged**2
    return np.where(too_far, np.trunc(wanted), rounded).astype(np.int64)


def _interpolate(nodes: Float32[ndarray, "2 a b"], size: int, grain: int, axis: int) -> Float32[ndarray, "2 c d"]:
    """Nodes that stand `grain` pixels apart, interpolated linearly at each of `size` pixels."""
    before, rest = np.divmod(np.arange(size), grain)
    weight = (rest / np.float32(grain)).astype(np.float32).reshape([-1 if each == axis else 1 for each in range(3)])
    return nodes.take(before, axis) * (1 - weight) + nodes.take(before + 1, axis) * weight
