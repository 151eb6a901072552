"""Covariances of Gaussians and back: what merging several into one needs, inside other kernels."""

from __future__ import annotations

import math

import numba

_SWEEPS = 5
"""Jacobi sweeps: after them float32 has nothing left to gain."""
_PAIRS = ((0, 1), (0, 2), (1, 2))
_LEAST_VARIANCE = 1e-12
"""m²: flatter splats get this, so that logarithms stay finite."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_covariance(quat, log_scales, weight, total):
    """Add weight · R S² Rᵀ to the six numbers xx, xy, xz, yy, yz, zz in `total`, which is float64."""
    w, x, y, z = float(quat[0]), float(quat[1]), float(quat[2]), float(quat[3])
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w * scale, x * scale, y * scale, z * scale
    columns = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
    for axis in range(3):
        a, b, c = columns[axis]
        variance = weight * math.exp(2 * float(log_scales[axis]))
        total[0] += variance * a * a
        total[1] += variance * a * b
        total[2] += variance * a * c
        total[3] += variance * b * b
        total[4] += variance * b * c
        total[5] += variance * c * c


@numba.njit(cache=True, nogil=True, error_model="numpy")
def split_covariance(covariance, matrix, vectors, quat, log_scales):
    """Write the quaternion (w first) and log standard deviations of a covariance of six numbers.

    `matrix` and `vectors` are room for two 3 × 3 matrices (float64). Eigenvectors by Jacobi's rotations.
    """
    matrix[0, 0], matrix[1, 1], matrix[2, 2] = covariance[0], covariance[3], covariance[5]
    matrix[0, 1] = matrix[1, 0] = covariance[1]
    matrix[0, 2] = matrix[2, 0] = covariance[2]
    matrix[1, 2] = matrix[2, 1] = covariance[4]
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        for p, q in _PAIRS:
            _rotate(matrix, vectors, p, q)
    if _determinant(vectors) < 0:
        for i in range(3):
            vectors[i, 2] = -vectors[i, 2]
    _write_quaternion(vectors, quat)
    for i in range(3):
        log_scales[i] = 0.5 * math.log(max(matrix[i, i], _LEAST_VARIANCE))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _rotate(matrix, vectors, p, q):
    """Turn so that the entry (p, q) becomes 0."""
    off = matrix[p, q]
    if off * off <= 1e-28 * abs(matrix[p, p] * matrix[q, q]):
        return
    theta = 0.5 * (matrix[q, q] - matrix[p, p]) / off
    tangent = (1.0 if theta >= 0 else -1.0) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for k in range(3):
        a, b = matrix[k, p], matrix[k, q]
        matrix[k, p], matrix[k, q] = cosine * a - sine * b, sine * a + cosine * b
    for k in range(3):
        a, b = matrix[p, k], matrix[q, k]
        matrix[p, k], matrix[q, k] = cosine * a - sine * b, sine * a + cosine * b
    for k in range(3):
        a, b = vectors[k, p], vectors[k, q]
        vectors[k, p], vectors[k, q] = cosine * a - sine * b, sine * a + cosine * b


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _determinant(m):
    return (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _write_quaternion(m, quat):
    """Write the quaternion of a rotation matrix (Shepperd 1978): the largest of its parts is computed first."""
    x, y, z = m[0, 0], m[1, 1], m[2, 2]
    squares = (1 + x + y + z, 1 + x - y - z, 1 - x + y - z, 1 - x - y + z)
    largest = 0
    for part in range(1, 4):
        if squares[part] > squares[largest]:
            largest = part
    double = 2 * math.sqrt(squares[largest])
    turns = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
    sums = (m[1, 2] + m[2, 1], m[0, 2] + m[2, 0], m[0, 1] + m[1, 0])
    for part in range(4):
        if part == largest:
            quat[part] = double / 4
        elif largest == 0 or part == 0:
            quat[part] = turns[largest + part - 1] / double
        else:
            quat[part] = sums[5 - largest - part] / double
