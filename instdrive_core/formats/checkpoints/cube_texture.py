"""Skies that other trainers keep as the six faces of an OpenGL cube map."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.torch_checkpoint import TorchCheckpoint
from instdrive_core.formats.checkpoints.splat_part import REMEDY
from instdrive_core.scene.sky import Sky, compute_texel_directions

_FACE_AXES = np.array([[2, 1], [2, 1], [0, 2], [0, 2], [0, 1], [0, 1]])
"""Axes that columns and rows of each face run along."""
_FACE_SIGNS = np.array([[-1, -1], [1, -1], [1, 1], [1, -1], [1, -1], [-1, -1]])

_MAX_SKY = 4096


def read_cube_sky(
    file: TorchCheckpoint, value: Any, texture_from_world: Float[ndarray, "3 3"], left_out: list[str]
) -> Sky | None:
    """Read a cube map; where it is none, say so in `left_out`. Raises DataError where its colours are no numbers."""
    tensor = file.find_tensor(value)
    if tensor is None or len(tensor.shape) != 4 or tensor.shape[0] != 6 or tensor.shape[3] != 3:
        left_out.append("the sky, as it is no cube map")
        return None
    if not 0 < tensor.shape[1] == tensor.shape[2] <= _MAX_SKY:
        raise DataError(file.path, f"the sky has faces of {tensor.shape[1:3]} pixels", REMEDY)
    faces = tensor.read()
    if not np.isfinite(faces).all():
        raise DataError(file.path, "the sky holds colours that are no numbers", REMEDY)
    return build_sky(faces, texture_from_world)


def build_sky(faces: Float[ndarray, "6 r r 3"], texture_from_world: Float[ndarray, "3 3"]) -> Sky:
    """Build a sky of OpenGL's faces +x, -x, +y, -y, +z, -z (OpenGL 4.6, table 8.19); texels are moved, not mixed.

    Args:
        faces: colours, cut off outside of [0, 1].
        texture_from_world: signed permutation from directions of the world to those of the cube map.
    """
    resolution = faces.shape[1]
    directions = compute_texel_directions(resolution) @ np.asarray(texture_from_world, np.float64).T
    axis = np.abs(directions).argmax(axis=-1)
    major = np.take_along_axis(directions, axis[..., None], axis=-1)[..., 0]
    face = 2 * axis + (major < 0)
    across = np.take_along_axis(directions, _FACE_AXES[face], axis=-1) * _FACE_SIGNS[face] / np.abs(major)[..., None]
    texels = np.clip((across + 1) * (resolution / 2), 0, resolution - 1).astype(np.int64)
    return Sky(np.clip(faces[face, texels[..., 1], texels[..., 0]], 0, 1).astype(np.float32))
