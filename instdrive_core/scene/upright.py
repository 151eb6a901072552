"""Which way is up: names of the axes, and the rotation that stands a scene upright."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
AXES: tuple[Axis, ...] = get_args(Axis)
"""All axes."""
UP: Axis = "+z"
"""Up axis of every scene in this program."""
_EXACT = 1e-9
"""Largest error of a matrix that still counts as a quarter turn."""


def compute_axis_direction(axis: Axis) -> Float64[ndarray, "3"]:
    """Compute the unit vector along an axis."""
    direction = np.zeros(3)
    direction["xyz".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return direction


def format_axis(axis: Axis) -> str:
    """Write an axis as people do: ``−Y``, with a sign as wide as the plus; commands take ``-y``."""
    return axis.upper().replace("-", "−")


def find_nearest_axis(direction: Float[ndarray, "3"]) -> tuple[Axis, float]:
    """Find the axis nearest to a direction of any length above 0, and the angle between them in degrees."""
    unit = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    axis = max(AXES, key=lambda name: float(compute_axis_direction(name) @ unit))
    cross = np.linalg.norm(np.cross(compute_axis_direction(axis), unit))  # unlike the cosine, exact for small angles
    return axis, float(np.degrees(np.arctan2(cross, compute_axis_direction(axis) @ unit)))


def compute_upright_rotation(up: Float[ndarray, "3"]) -> Float64[ndarray, "3 3"]:
    """Compute the shortest rotation that takes `up`, of any length above 0, to +z; exact for axes.

    What points along -z is turned about y, so that forward stays forward.
    """
    x, y, z = np.asarray(up, np.float64) / np.linalg.norm(up)
    squared_sine = x * x + y * y
    if z < 0 and squared_sine < 1e-24:
        return np.diag([-1.0, 1.0, -1.0])
    # Rodrigues' formula for the axis (y, -x, 0), whose length is the sine and z the cosine of the angle. Near -z the
    # sum 1 + z has lost its digits; the quotient is the same number.
    share = (1 - z) / squared_sine if z < 0 else 1 / (1 + z)
    rotation = np.array([[1 - x * x * share, -x * y * share, -x], [-x * y * share, 1 - y * y * share, -y], [x, y, z]])
    return snap_rotation(rotation)


def snap_rotation(rotation: Float64[ndarray, "3 3"]) -> Float64[ndarray, "3 3"]:
    """Return the quarter turn that a matrix is but for rounding, else the matrix: exact turns keep every coordinate."""
    whole = np.round(rotation)
    return whole + 0.0 if np.abs(rotation - whole).max() < _EXACT else rotation


def is_quarter_turn(rotation: Float64[ndarray, "3 3"]) -> bool:
    """Whether a rotation takes axes to axes."""
    return bool((np.abs(rotation).max(axis=1) == 1).all())
