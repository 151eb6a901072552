"""Waymo's range images: a row per beam, a column per direction, from the back by the left to the back."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.recording import Pose


def compute_beam_inclinations(low: float, high: float, rows: int) -> Float64[ndarray, " r"]:
    """Compute evenly spread inclinations in radians, the lowest first, each in the middle of its share."""
    return low + (np.arange(rows) + 0.5) / rows * (high - low)


def compute_pixel_directions(
    inclinations: Float64[ndarray, " r"], columns: int, car_from_laser: Pose
) -> Float64[ndarray, "r c 3"]:
    """Compute the unit directions of a range image's pixels in the laser's axes.

    Args:
        inclinations: the lowest first, as files list them; a range image has the highest in its first row.
        columns: the range image's width.
        car_from_laser: its turn about z is taken away, so that columns begin behind the car.
    """
    correction = np.arctan2(car_from_laser[1, 0], car_from_laser[0, 0])
    azimuths = ((np.arange(columns, 0, -1) - 0.5) / columns * 2 - 1) * np.pi - correction
    rises = inclinations[::-1, None]
    level = np.cos(rises)
    return np.stack(
        [level * np.cos(azimuths), level * np.sin(azimuths), np.broadcast_to(np.sin(rises), (len(rises), columns))],
        axis=-1,
    )


def build_turns(angles: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3 3"]:
    """Build rotations from roll, pitch and yaw in radians: about x first, then y, then z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles).T, np.sin(angles).T
    rows = [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def list_turn_angles(turn: Float64[ndarray, "3 3"]) -> Float64[ndarray, "3"]:
    """List roll, pitch and yaw of a rotation."""
    return np.array(
        [
            np.arctan2(turn[2, 1], turn[2, 2]),
            np.arctan2(-turn[2, 0], np.hypot(turn[2, 1], turn[2, 2])),
            np.arctan2(turn[1, 0], turn[0, 0]),
        ]
    )
