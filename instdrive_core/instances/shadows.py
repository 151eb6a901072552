"""Splats that are no surface photos showed: the column that marks them, and shadows that moving objects learn."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32, UInt16
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions
from instdrive_core.maths.spherical_harmonics import color_from_dc

SYNTHETIC = "synthetic"
"""Name of the per-splat column that is 0 for surfaces that photos showed, 1 for splats that fill holes, and `SHADOW`,
`MIRRORED` or `LEARNED_SHADOW`. Also the class of what fills holes."""
SHADOW = 2
"""Value of that column for the splats of a shadow that was laid below a thing."""
MIRRORED = 3
"""Value of that column for the splats of a side that nobody saw, mirrored from the other one."""
LEARNED_SHADOW = 4
"""Value of that column for the splats of the shadow that photos show below an object that moves."""
SHADOWS = (SHADOW, LEARNED_SHADOW)
"""Values of that column for all shadows."""
LOWEST, HIGHEST = -0.4, 0.3
"""Metres above the lower face of a moving object's box between which its shadow lies: boxes end beside the ground."""
THICKNESS = 0.05
"""Metres: what has a larger standard deviation along the box's height lies on nothing."""
BESIDE, THICKNESS_BESIDE = 0.3, 0.3
"""Metres from the box from which on nothing is the object itself, and the same limit there: photos do not say how high
what darkens the ground lies above it."""
LEAST_SIZE = 0.05
"""Metres: what has no standard deviation of that size may be anything."""
DARK = 0.3
"""Mean of R, G and B up to which a splat takes light away from what it lies on."""


def find_learned_shadows(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    log_scales: Float32[ndarray, "n 3"],
    sh_dc: Float32[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    dimensions: Float[ndarray, "k 3"],
) -> Bool[ndarray, " n"]:
    """Find the splats that lie dark and flat on the ground around a moving object's foot, and belong to it.

    `dimensions` (metres) are those of the boxes of nodes 1, 2, …, in whose frames means and quaternions are.
    """
    found = np.zeros(len(means), bool)
    rows = np.flatnonzero(nodes > 0)
    half = dimensions[nodes[rows] - 1] / 2
    above = means[rows, 2] + half[:, 2]
    low = (above >= LOWEST) & (above <= HIGHEST) & (color_from_dc(sh_dc[rows]).mean(axis=1) <= DARK)
    rows, half = rows[low], half[low]
    beside = (np.abs(means[rows, :2]) > half[:, :2] + BESIDE).any(axis=1)
    scales = np.exp(log_scales[rows])
    upwards = matrix_from_quaternion(normalize_quaternions(quats[rows]))[:, 2] * scales
    flat = (upwards.astype(np.float64) ** 2).sum(axis=1) <= np.where(beside, THICKNESS_BESIDE, THICKNESS) ** 2
    found[rows[flat & (scales.max(axis=1) >= LEAST_SIZE)]] = True
    return found


def mark_learned_shadows(shadows: Bool[ndarray, " n"]) -> dict[str, ndarray]:
    """Make the column that marks learned shadows; none where there are none."""
    return {SYNTHETIC: np.where(shadows, LEARNED_SHADOW, 0).astype(np.uint8)} if shadows.any() else {}


def name_splats(extra: Mapping[str, ndarray]) -> Int32[ndarray, " k"]:
    """Name what each splat stands for where a pixel is picked: its row; -1 for a shadow, through which one points at
    the ground. Empty where there are no shadows."""
    column = extra.get(SYNTHETIC)
    shadows = np.zeros(0, bool) if column is None else np.isin(column, SHADOWS)
    if not shadows.any():
        return np.zeros(0, np.int32)
    return np.where(shadows, np.int32(-1), np.arange(len(shadows), dtype=np.int32))


def find_marked_shadows(extra: Mapping[str, ndarray]) -> Bool[ndarray, " n"] | None:
    """Find the learned shadows that a scene's columns mark; None where they mark nothing."""
    return extra[SYNTHETIC] == LEARNED_SHADOW if SYNTHETIC in extra else None
