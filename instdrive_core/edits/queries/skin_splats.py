"""Splats that cover a skin in the colours of what lies around."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.edits.queries.closed_body import Skin
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.scene.gaussians import Gaussians

_NEAREST = 24
"""Splats around of which a place of the skin takes the median colour."""
_WIDTH = 1.4
"""Standard deviation of a splat in halves of its patch's sides: with less, light comes through between them."""
_THICKNESS = 0.01
"""Standard deviation across the skin, metres."""
_OPACITY_LOGIT = 4.0
_SQUARE_ON = 1e-9


def cover_skin(
    skin: Skin, around: Gaussians, points: Float64[ndarray, "n 3"], linear: Float64[ndarray, "3 3"]
) -> tuple[Gaussians, Int64[ndarray, " k"]]:
    """Cover a skin with splats, and say for each of them which splat of those around is nearest.

    `points` are the means of those around in the skin's frame. The splats' ellipsoids are given in the frame that
    `linear` (s R) turns and scales into the skin's; their means are the skin's places.
    """
    count = min(_NEAREST, len(points))
    near = np.asarray(KDTree(points).query(skin.places, k=count)[1]).reshape(len(skin), count)
    nearest = near[:, 0].astype(np.int64)
    scale = float(np.cbrt(np.linalg.det(linear)))
    axes, widths = _find_axes(skin)
    log_scales = np.log(np.c_[widths * _WIDTH, np.full(len(skin), _THICKNESS)] / scale)
    taken = around.select(nearest)
    splats = replace(
        taken,
        means=skin.places.astype(np.float32),
        quats=quaternion_from_matrix((linear / scale).T @ axes).astype(np.float32),
        log_scales=log_scales.astype(np.float32),
        opacity_logits=np.full(len(skin), _OPACITY_LOGIT, np.float32),
        sh_dc=np.median(around.sh_dc[near], axis=1).astype(np.float32),
        sh_rest=np.zeros_like(taken.sh_rest),
    )
    return splats, nearest


def _find_axes(skin: Skin) -> tuple[Float64[ndarray, "n 3 3"], Float64[ndarray, "n 2"]]:
    """Unit vectors of each patch as columns, the last one across it, and halves of its two sides, metres."""
    first = np.linalg.norm(skin.along, axis=1, keepdims=True)
    along = skin.along / np.maximum(first, _SQUARE_ON)
    across = skin.around - (skin.around * along).sum(axis=1, keepdims=True) * along
    second = np.linalg.norm(across, axis=1, keepdims=True)
    across = across / np.maximum(second, _SQUARE_ON)
    widths = np.maximum(np.c_[first, second], _THICKNESS)
    return np.stack([along, across, np.cross(along, across)], axis=2), widths
