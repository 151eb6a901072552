"""Positions and colours of a .ply's vertices, by property name."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

_COLORS = ("red", "green", "blue")


def join_ply_points(rows: ndarray) -> tuple[Float64[ndarray, "n 3"], UInt8[ndarray, "n 3"] | None]:
    """Join the positions of vertices with x, y and z, and their colours, stored as bytes or as floats to 1.

    The colours are None where there are none.
    """
    with np.errstate(invalid="ignore"):  # NaN of every kind is found by who asks
        points = np.stack([rows[axis] for axis in "xyz"], axis=1).astype(np.float64)
    if not set(_COLORS) <= set(rows.dtype.names or ()):
        return points, None
    colors = np.stack([rows[name].astype(np.float64) for name in _COLORS], axis=1)
    if rows.dtype["red"].kind == "f":
        colors = np.nan_to_num(colors) * 255
    return points, np.clip(np.round(colors), 0, 255).astype(np.uint8)
