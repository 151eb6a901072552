"""How well a photo agrees with its partners, pixel by pixel, if everything lay on one plane after another.

Planes are parallel to the photo (Collins 1996, "A space-sweep approach to true multi-image matching").
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from instdrive_core.scene.camera import Camera
from instdrive_core.stereo.pixel_relation import carry_over, relate_pixels

UNKNOWN = 160
"""Cost where no partner shows the pixel: neither good nor bad."""
_RADIUS = 2
"""Pixels on either side that a window of comparison reaches."""
_FLATNESS = 1.5
"""Standard deviation of grey values (0 to 255) below which a window shows nothing to compare."""


def compute_costs(
    grey: Float32[ndarray, "h w"],
    camera: Camera,
    partners: list[tuple[Float32[ndarray, "..."], Camera]],
    inverse_depths: Float64[ndarray, " d"],
) -> UInt8[ndarray, "h w d"]:
    """Compute the cost of each pixel at each inverse depth: 0 = partners show the same, 255 = nothing alike.

    Windows are compared by normalized cross-correlation, so that brightness and contrast may differ; of the partners
    that show a pixel the better half counts, since others may have something in between.

    Args:
        grey: of the photo, 0 to 255.
        camera: of the photo.
        partners: grey photos with their cameras.
        inverse_depths: of the planes, 1 / metres along the optical axis.
    """
    count = len(partners)
    height, width = (max(photo.shape[side] for photo, _ in partners) for side in (0, 1))
    photos = np.zeros((count, height, width), np.float32)
    sizes, turns, shifts = np.zeros((count, 2), np.int64), np.zeros((count, 3, 3)), np.zeros((count, 3))
    for row, (photo, partner) in enumerate(partners):
        photos[row, : photo.shape[0], : photo.shape[1]] = photo
        sizes[row] = photo.shape
        turns[row], shifts[row] = relate_pixels(camera, partner)
    return _sweep(grey, photos, sizes, turns, shifts, inverse_depths)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sweep(
    grey: Float32[ndarray, "h w"],
    photos: Float32[ndarray, "k h2 w2"],
    sizes: ndarray,
    turns: Float64[ndarray, "k 3 3"],
    shifts: Float64[ndarray, "k 3"],
    inverse_depths: Float64[ndarray, " d"],
) -> UInt8[ndarray, "h w d"]:
    height, width = grey.shape
    count, planes = len(photos), len(inverse_depths)
    costs = np.empty((height, width, planes), np.uint8)
    best = np.empty((count, height, width), np.float32)
    warped, inside = np.empty((height, width), np.float32), np.empty((height, width), np.bool_)
    product, square = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    area = np.float32((2 * _RADIUS + 1) ** 2)
    mean = _sum_windows(grey) / area
    spread = np.sqrt(np.maximum(_sum_windows(grey * grey) / area - mean * mean, 0))
    for plane in range(planes):
        for k in range(count):
            _warp(photos[k], sizes[k], turns[k], shifts[k], inverse_depths[plane], warped, inside)
            for row in range(height):
                for column in range(width):
                    product[row, column] = warped[row, column] * grey[row, column]
                    square[row, column] = warped[row, column] * warped[row, column]
            sums, products, squares = _sum_windows(warped), _sum_windows(product), _sum_windows(square)
            for row in range(height):
                for column in range(width):
                    if not inside[row, column]:
                        best[k, row, column] = np.inf
                        continue
                    own = sums[row, column] / area
                    other = np.sqrt(max(squares[row, column] / area - own * own, np.float32(0)))
                    joint = products[row, column] / area - own * mean[row, column]
                    divisor = max(other, _FLATNESS) * max(spread[row, column], _FLATNESS)
                    best[k, row, column] = min(max(np.float32(1) - joint / divisor, np.float32(0)), np.float32(1))
        for row in range(height):
            for column in range(width):
                costs[row, column, plane] = _mean_of_better_half(best[:, row, column])
    return costs


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _mean_of_better_half(values: Float32[ndarray, " k"]) -> int:
    valid = 0
    for value in values:
        valid += value < np.inf
    if not valid:
        return UNKNOWN
    total, last = np.float32(0), np.float32(-1)
    wanted, taken = (valid + 1) // 2, 0
    while taken < wanted:
        least, times = np.float32(np.inf), 0
        for value in values:
            if last < value < least:
                least, times = value, 1
            elif value == least:
                times += 1
        times = min(times, wanted - taken)
        total += least * times
        taken += times
        last = least
    return int(total / wanted * 255 + 0.5)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _warp(
    photo: Float32[ndarray, "h2 w2"],
    size: ndarray,
    turn: Float64[ndarray, "3 3"],
    shift: Float64[ndarray, "3"],
    inverse: float,
    warped: Float32[ndarray, "h w"],
    inside: ndarray,
) -> None:
    """Look a partner up at all pixels; beyond its edge the nearest pixel stands in."""
    rows, columns = size
    for row in range(warped.shape[0]):
        for column in range(warped.shape[1]):
            x, y, z = carry_over(turn, shift, column + 0.5, row + 0.5, inverse)
            inside[row, column] = z > 1e-6 and 0 <= x < columns and 0 <= y < rows
            if not z > 1e-6:
                x, y = 0.0, 0.0
            x, y = min(max(x - 0.5, 0.0), columns - 1.001), min(max(y - 0.5, 0.0), rows - 1.001)
            left, top = int(x), int(y)
            a, b = np.float32(x - left), np.float32(y - top)
            upper = photo[top, left] + a * (photo[top, left + 1] - photo[top, left])
            lower = photo[top + 1, left] + a * (photo[top + 1, left + 1] - photo[top + 1, left])
            warped[row, column] = upper + b * (lower - upper)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sum_windows(values: Float32[ndarray, "h w"]) -> Float32[ndarray, "h w"]:
    """Sum each pixel's window; beyond the edge the nearest pixel is repeated."""
    height, width = values.shape
    along = np.empty((height, width), np.float32)
    for row in range(height):
        for column in range(width):
            total = np.float32(0)
            for step in range(-_RADIUS, _RADIUS + 1):
                total += values[row, min(max(column + step, 0), width - 1)]
            along[row, column] = total
    result = np.zeros((height, width), np.float32)
    for row in range(height):
        for step in range(-_RADIUS, _RADIUS + 1):
            source = min(max(row + step, 0), height - 1)
            for column in range(width):
                result[row, column] += along[source, column]
    return result
