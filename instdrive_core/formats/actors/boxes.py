"""Putting Gaussians that another trainer keeps in its own axes of a thing into the box of an actor."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_core.maths.rotations import (
    matrix_from_quaternion,
    multiply_quaternions,
    normalize_quaternions,
    quaternion_from_matrix,
)
from instdrive_core.maths.sh_rotation import rotate_rest
from instdrive_core.scene.gaussians import Gaussians

BOX_FROM_FORWARD_X = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
"""From x forward, y left to x right, y forward."""


def build_poses(quats: Float[ndarray, "t 4"], translations: Float[ndarray, "t 3"]) -> Float64[ndarray, "t 4 4"]:
    """Build world_from_thing of quaternions wxyz of any length, and places in metres."""
    poses = np.tile(np.eye(4), (len(quats), 1, 1))
    poses[:, :3, :3] = matrix_from_quaternion(normalize_quaternions(quats.astype(np.float64)))
    poses[:, :3, 3] = translations
    return poses


def turn_into_box(
    part: Gaussians, pose: Float[ndarray, "4 4"], turn: Float[ndarray, "3 3"], center: Float[ndarray, "3"]
) -> None:
    """Turn Gaussians into a box's axes, in place.

    Args:
        part: in the thing's own axes, but for colours above the constant SH, which are in the world's.
        pose: world_from_thing at the moment at which these colours shall be right.
        turn: box_from_thing.
        center: of the box, in the thing's own axes.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # the linter reports what is not finite
        part.means[:] = (part.means - center) @ turn.T
        quats = normalize_quaternions(part.quats)
        part.quats[:] = multiply_quaternions(np.broadcast_to(quaternion_from_matrix(turn), quats.shape), quats)
        # Colours are stored along the world's axes; in this frame the box lies at pose turnᵀ.
        part.sh_rest[:] = rotate_rest(part.sh_rest, turn @ pose[:3, :3].T)
