"""Quaternions (wxyz) and rotation matrices."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_NEARLY_EQUAL = 0.9995
"""Cosine of half the angle from which on `slerp` goes straight: the arc's formula would divide by almost nothing."""


def normalize_quaternions(quats: Float[ndarray, "*n 4"]) -> Float[ndarray, "*n 4"]:
    """Scale quaternions to length 1; a zero quaternion becomes the identity."""
    norms = np.linalg.norm(quats, axis=-1, keepdims=True)
    identity = np.zeros_like(quats)
    identity[..., 0] = 1
    return np.where(norms > 1e-12, quats / np.maximum(norms, 1e-12), identity)


def matrix_from_quaternion(quats: Float[ndarray, "*n 4"]) -> Float[ndarray, "*n 3 3"]:
    """Compute rotation matrices from quaternions wxyz of any length."""
    w, x, y, z = np.moveaxis(normalize_quaternions(quats), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_matrix(matrices: Float[ndarray, "*n 3 3"]) -> Float[ndarray, "*n 4"]:
    """Compute unit quaternions wxyz (w ≥ 0) from rotation matrices, by the largest of the four candidates."""
    m = np.asarray(matrices)
    r = {(i, j): m[..., i, j] for i in range(3) for j in range(3)}
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    candidates = np.stack(
        [
            np.stack([1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]], -1),
            np.stack([r[2, 1] - r[1, 2], 1 + 2 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]], -1),
            np.stack([r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 + 2 * r[1, 1] - trace, r[1, 2] + r[2, 1]], -1),
            np.stack([r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 + 2 * r[2, 2] - trace], -1),
        ],
        axis=-2,
    )
    sizes = np.stack([candidates[..., k, k] for k in range(4)], axis=-1)
    best = np.argmax(sizes, axis=-1)
    quats = normalize_quaternions(np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :])
    return np.where(quats[..., :1] < 0, -quats, quats)


def multiply_quaternions(left: Float[ndarray, "*n 4"], right: Float[ndarray, "*n 4"]) -> Float[ndarray, "*n 4"]:
    """Compute the Hamilton product, which rotates by `right`, then by `left`."""
    (w, x, y, z), (a, b, c, d) = (np.moveaxis(np.asarray(quats), -1, 0) for quats in (left, right))
    parts = (
        w * a - x * b - y * c - z * d,
        x * a + w * b - z * c + y * d,
        y * a + z * b + w * c - x * d,
        z * a - y * b + x * c + w * d,
    )
    return np.stack(parts, axis=-1)


def slerp(
    start: Float[ndarray, "*n 4"], end: Float[ndarray, "*n 4"], fraction: Float[ndarray, "*n"] | float
) -> Float[ndarray, "*n 4"]:
    """Interpolate spherically along the shorter arc; `fraction` 0 gives `start`, 1 gives `end`."""
    start, end = normalize_quaternions(start), normalize_quaternions(end)
    share = np.asarray(fraction)[..., None]
    cosine = (start * end).sum(axis=-1, keepdims=True)
    end, cosine = np.where(cosine < 0, -end, end), np.abs(cosine)
    straight = normalize_quaternions(start + share * (end - start))
    angle = np.arccos(np.minimum(cosine, _NEARLY_EQUAL))
    curved = (np.sin((1 - share) * angle) * start + np.sin(share * angle) * end) / np.sin(angle)
    return np.where(cosine > _NEARLY_EQUAL, straight, curved)
