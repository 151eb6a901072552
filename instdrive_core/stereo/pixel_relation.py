"""Where a pixel of one photo lies in another, by how far off it is."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera


def relate_pixels(camera: Camera, partner: Camera) -> tuple[Float64[ndarray, "3 3"], Float64[ndarray, "3"]]:
    """Relate the pixels of two cameras: a turn and a shift, as `carry_over` takes them."""
    between = partner.camera_from_world @ camera.world_from_camera
    turn = partner.intrinsics @ between[:3, :3] @ np.linalg.inv(camera.intrinsics)
    return turn, partner.intrinsics @ between[:3, 3]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def carry_over(
    turn: Float64[ndarray, "3 3"], shift: Float64[ndarray, "3"], u: float, v: float, inverse: float
) -> tuple[float, float, float]:
    """Carry a place (u, v) of the first photo over to the second: x, y, and depth there as a multiple of its own.

    Where the third is not positive, the place lies behind the second camera and x, y mean nothing. `inverse` is the
    place's inverse depth, 1 / metres.
    """
    z = turn[2, 0] * u + turn[2, 1] * v + turn[2, 2] + inverse * shift[2]
    x = (turn[0, 0] * u + turn[0, 1] * v + turn[0, 2] + inverse * shift[0]) / z
    y = (turn[1, 0] * u + turn[1, 1] * v + turn[1, 2] + inverse * shift[1]) / z
    return x, y, z
