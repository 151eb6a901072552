"""Splats binned into tiles of directions: which of them rays may meet that look through a tile.

A splat's tiles are those of the box of directions around its ellipsoid, which for a flat one that is seen aslant, such
as the road ahead, is far lower than that of the sphere around it.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64
from numpy import ndarray

_STEEPEST = 0.5
"""Sine of the least angle to the vertical at which the box of an ellipsoid is known; steeper ones have the sphere's."""


@numba.njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def whiten(quats: ndarray, log_scales: ndarray) -> Float32[ndarray, "n 3 3"]:
    """Compute M = S⁻¹ Rᵀ of each splat, from unit quaternions w x y z."""
    matrices = np.empty((len(quats), 3, 3), np.float32)
    for i in numba.prange(len(quats)):
        w, x, y, z = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
        a, b, c = np.exp(-log_scales[i, 0]), np.exp(-log_scales[i, 1]), np.exp(-log_scales[i, 2])
        matrices[i, 0, 0] = a * (1 - 2 * (y * y + z * z))
        matrices[i, 0, 1] = a * (2 * (x * y + w * z))
        matrices[i, 0, 2] = a * (2 * (x * z - w * y))
        matrices[i, 1, 0] = b * (2 * (x * y - w * z))
        matrices[i, 1, 1] = b * (1 - 2 * (x * x + z * z))
        matrices[i, 1, 2] = b * (2 * (y * z + w * x))
        matrices[i, 2, 0] = c * (2 * (x * z + w * y))
        matrices[i, 2, 1] = c * (2 * (y * z - w * x))
        matrices[i, 2, 2] = c * (1 - 2 * (x * x + y * y))
    return matrices


@numba.njit(cache=True, parallel=True, error_model="numpy")
def find_velocities(
    places: Float32[ndarray, "n 3"], nodes: ndarray, turns: Float64[ndarray, "m 3 4"], step: float
) -> Float32[ndarray, "n 3"]:
    """Compute the velocity (m/s) of each place whose node a turn moves within `step` seconds."""
    velocities = np.empty((len(places), 3), np.float32)
    for i in numba.prange(len(places)):
        turn, x, y, z = turns[nodes[i]], float(places[i, 0]), float(places[i, 1]), float(places[i, 2])
        for axis in range(3):
            after = turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z + turn[axis, 3]
            velocities[i, axis] = (after - places[i, axis]) / step
    return velocities


@numba.njit(cache=True, parallel=True, error_model="numpy")
def find_tile_ranges(
    centers: Float32[ndarray, "n 3"],
    matrices: Float32[ndarray, "n 3 3"],
    deviations: Float32[ndarray, " n"],
    spares: Float32[ndarray, " n"],
    middle: Float32[ndarray, "3"],
    used: Bool[ndarray, " k"],
    far: float,
    lowest: float,
    side: float,
    rows: int,
    columns: int,
) -> tuple[Int32[ndarray, "n 4"], Float32[ndarray, " n"]]:
    """Find the tiles that each splat covers: first and last row, first column, count of columns.

    The second result are the distances of the centres from the middle, metres.

    Args:
        centers: of splats, in the sensor's axes, metres.
        matrices: of `whiten`.
        deviations: standard deviations up to which each splat is seen.
        spares: metres by which splats and rays may be elsewhere; splats with less than 0 are passed over.
        middle: from where tiles are seen.
        used: tiles through which rays look, row-major; a splat that covers none of them has a count of columns of 0.
        far: splats that begin beyond are passed over; their count of columns is 0.
        lowest: elevation at which row 0 begins, radians.
        side: height and width of a tile, radians.
        rows: rows of tiles.
        columns: columns of tiles all around; column 0 begins at azimuth -π.
    """
    found, distances = np.zeros((len(centers), 4), np.int32), np.empty(len(centers), np.float32)
    for i in numba.prange(len(centers)):
        x, y, z = centers[i, 0] - middle[0], centers[i, 1] - middle[1], centers[i, 2] - middle[2]
        distance = math.sqrt(x * x + y * y + z * z)
        distances[i] = distance
        if spares[i] < 0:
            continue
        high, wide = _measure_angles(x, y, z, distance, matrices[i], deviations[i], spares[i], far)
        if high < 0:
            continue
        elevation = math.asin(max(-1.0, min(1.0, z / max(distance, 1e-6))))
        first, last = (
            math.floor((elevation - high - lowest) / side),
            math.floor((elevation + high - lowest) / side),
        )
        first, last = max(first, 0), min(last, rows - 1)
        if last < first:
            continue
        azimuth = math.atan2(y, x) + math.pi
        start = math.floor((azimuth - wide) / side)
        count = min(math.floor((azimuth + wide) / side) - start + 1, columns)
        if _covers_used(first, last, start % columns, count, used, columns):
            found[i, 0], found[i, 1], found[i, 2], found[i, 3] = first, last, start % columns, count
    return found, distances


@numba.njit(cache=True, error_model="numpy")
def _measure_angles(
    x: float, y: float, z: float, distance: float, matrix: ndarray, deviation: float, spare: float, far: float
) -> tuple[float, float]:
    """Half the elevations and azimuths that an ellipsoid covers around its centre, radians; -1 where it is too far."""
    squares = np.empty(3)
    for axis in range(3):
        squares[axis] = 1.0 / max(matrix[axis, 0] ** 2 + matrix[axis, 1] ** 2 + matrix[axis, 2] ** 2, 1e-20)
    reach = deviation * math.sqrt(max(squares[0], squares[1], squares[2])) + spare
    if not distance - reach < far:
        return -1.0, -1.0
    if distance <= reach:
        return math.pi, math.pi
    flat = math.sqrt(x * x + y * y)
    half, across = math.asin(reach / distance), math.pi
    if math.asin(min(abs(z) / distance, 1.0)) + half < 0.5 * math.pi - 1e-3:
        across = math.asin(min(math.sin(half) * distance / flat, 1.0))
    if flat < _STEEPEST * distance:
        return half, across
    ahead = deviation * _measure_extent(matrix, squares, x / distance, y / distance, z / distance) + spare
    aside = deviation * _measure_extent(matrix, squares, -y / flat, x / flat, 0.0) + spare
    above = (
        deviation
        * _measure_extent(matrix, squares, -x * z / (flat * distance), -y * z / (flat * distance), flat / distance)
        + spare
    )
    # The nearest that the ellipsoid comes along the ground; what lies aside of its centre looks nearer to the horizon,
    # by a quarter of the squared angle at most.
    ground = (flat * (distance - ahead) - above * abs(z)) / distance
    if ground <= 0:
        return half, across
    turned = aside / ground
    return min(half, math.atan2(above, distance - ahead) + 0.25 * turned * turned), min(across, math.atan(turned))


@numba.njit(cache=True, error_model="numpy")
def _measure_extent(matrix: ndarray, squares: ndarray, x: float, y: float, z: float) -> float:
    """Standard deviation along a unit vector u: |S Rᵀ u|, of which each part is that of M u times a squared scale."""
    total = 0.0
    for axis in range(3):
        part = squares[axis] * (matrix[axis, 0] * x + matrix[axis, 1] * y + matrix[axis, 2] * z)
        total += part * part
    return math.sqrt(total)


@numba.njit(cache=True)
def _covers_used(first: int, last: int, start: int, count: int, used: ndarray, columns: int) -> bool:
    for row in range(first, last + 1):
        for step in range(count):
            if used[row * columns + (start + step) % columns]:
                return True
    return False


@numba.njit(cache=True)
def fill_tiles(
    order: Int64[ndarray, " n"], ranges: Int32[ndarray, "n 4"], used: ndarray, columns: int
) -> tuple[Int64[ndarray, " k"], Int32[ndarray, " m"]]:
    """List the splats of each tile in an order: where each tile's list begins, and the lists one after the other.

    Tiles that no ray looks through (`used`, row-major) stay empty.
    """
    starts = np.zeros(len(used) + 1, np.int64)
    for i in order:
        for row in range(ranges[i, 0], ranges[i, 1] + 1):
            for step in range(ranges[i, 3]):
                tile = row * columns + (ranges[i, 2] + step) % columns
                if used[tile]:
                    starts[tile + 1] += 1
    for tile in range(len(used)):
        starts[tile + 1] += starts[tile]
    lists, filled = np.empty(starts[-1], np.int32), starts[:-1].copy()
    for i in order:
        for row in range(ranges[i, 0], ranges[i, 1] + 1):
            for step in range(ranges[i, 3]):
                tile = row * columns + (ranges[i, 2] + step) % columns
                if used[tile]:
                    lists[filled[tile]] = i
                    filled[tile] += 1
    return starts, lists
