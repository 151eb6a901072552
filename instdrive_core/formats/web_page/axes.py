"""Axes of the viewer: it turns a file's y from down to up, so z has to become -y before."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64, Int64
from numpy import ndarray

from instdrive_core.formats.sog.writing import bound_position_error, order_for_sog

FILE_FROM_SCENE = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0]])
"""x stays, z up becomes -y."""
SCENE_FROM_FILE = np.c_[FILE_FROM_SCENE[:, :3].T, np.zeros(3)]
_VIEWER_FROM_FILE = np.diag([-1.0, -1.0, 1.0])


def turn_means_for_file(means: Float[ndarray, "n 3"]) -> Float[ndarray, "n 3"]:
    """Turn positions into the file's axes, bit by bit."""
    return np.stack([means[:, 0], -means[:, 2], means[:, 1]], axis=1)


def turn_point_for_viewer(point: Float[ndarray, "3"]) -> Float64[ndarray, "3"]:
    """Turn a position or direction of the scene into the viewer's world, y up."""
    return _VIEWER_FROM_FILE @ FILE_FROM_SCENE[:, :3] @ point


def order_for_page(means: Float[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
    """Row numbers in the order of the page's .sog."""
    return order_for_sog(turn_means_for_file(means))


def bound_page_error(means: Float[ndarray, "n 3"]) -> Float[ndarray, "n 3"]:
    """Bound the error of each coordinate, metres: that of the .sog."""
    return bound_position_error(turn_means_for_file(means))[:, [0, 2, 1]]
