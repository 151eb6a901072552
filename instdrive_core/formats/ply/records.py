"""The three .ply formats as records."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.formats.ply.compare import find_changed_value
from instdrive_core.formats.ply.compressed import read_compressed_ply, write_compressed_ply
from instdrive_core.formats.ply.compressed_layout import CHUNK
from instdrive_core.formats.ply.inria import read_ply, write_ply
from instdrive_core.formats.ply.sibr import write_sibr_ply
from instdrive_core.formats.ply.sketch import sketch_ply
from instdrive_core.formats.scene_format import Fidelity, Format
from instdrive_core.formats.spatial_order import sort_spatially

_COMPRESSED_STEPS = np.array([2047, 1023, 2047])
"""Steps that a chunk's extent along x, y, z is divided into."""
_ROUNDING = 2.0**-22
"""Rounding of float32, relative to the largest coordinate: half a unit in the last place of bounds and of values."""


def _compute_position_error(means: ndarray) -> Float64[ndarray, "n 3"]:
    """Half a step of each splat's chunk along each axis, metres; `means` are in the file's order."""
    starts = np.arange(0, len(means), CHUNK)
    values = means.astype(np.float64)
    extents = np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)
    rounding = _ROUNDING * np.abs(values).max(axis=0)
    return extents[np.arange(len(values)) // CHUNK] / (2 * _COMPRESSED_STEPS) * (1 + 1e-6) + rounding


def _sort_into_chunks(means: ndarray) -> Int64[ndarray, " n"]:
    return sort_spatially(means, CHUNK)


INRIA_PLY = Format(
    "3D Gaussians, INRIA layout",
    ".ply",
    read_ply,
    write_ply,
    Fidelity(is_exact=True, find_change=find_changed_value),
    sketch=sketch_ply,
)
SIBR_PLY = Format(
    "INRIA layout for SIBR viewers",
    ".sibr.ply",
    read_ply,
    write_sibr_ply,
    Fidelity(is_exact=True, keeps_instances=False),
    sketch=sketch_ply,
)
COMPRESSED_PLY = Format(
    "Packed .ply of SuperSplat and PlayCanvas",
    ".compressed.ply",
    read_compressed_ply,
    write_compressed_ply,
    Fidelity(_compute_position_error, _sort_into_chunks),
)
