"""The blending weights of chosen pixels as a sparse matrix: with frozen geometry a rendered feature map is W·F.

Training instance features then needs no rasterizing: `apply_weights` is the forward pass of the chosen pixels,
`apply_weights_transposed` the gradient.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from jaxtyping import Float, Float32, Int, Int32, Int64
from numpy import ndarray

from instdrive_core.rasterize.bin import TILE, TileLists, bin_splats
from instdrive_core.rasterize.fragment import FAST, FLOOR, exponent_of, power_of_two
from instdrive_core.rasterize.layout import kernel_array
from instdrive_core.rasterize.project import Projection, project
from instdrive_core.rasterize.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera

_PIXELS_PER_TASK = 64


@dataclass(frozen=True)
class BlendWeights:
    """A P × N matrix of M weights, pixel by pixel; within a pixel nearest first."""

    indptr: Int64[ndarray, " p+1"]
    """Pixel p owns the entries indptr[p] … indptr[p + 1]."""
    rows: Int32[ndarray, " m"]
    """Gaussians."""
    weights: Float32[ndarray, " m"]

    @cached_property
    def _by_row(self) -> tuple[ndarray, ndarray, ndarray, ndarray]:
        """The same entries Gaussian by Gaussian: distinct rows, where each one's entries start, pixels, weights."""
        order = np.argsort(self.rows, kind="stable")
        rows, starts = np.unique(self.rows[order], return_index=True)
        pixels = np.repeat(np.arange(len(self.indptr) - 1, dtype=np.int32), np.diff(self.indptr))
        return rows, np.append(starts, len(order)), pixels[order], self.weights[order]


def blend_weights(
    means: Float[ndarray, "n 3"],
    quats: Float[ndarray, "n 4"],
    log_scales: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    camera: Camera,
    pixels: Int[ndarray, " p"],
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> BlendWeights:
    """Which Gaussians `render` blends at the given pixels (row-major, flat), and with which weights.

    Raises:
        ValueError: a pixel is outside the image.
    """
    pixels = np.ascontiguousarray(pixels, np.int64)
    if len(pixels) and not 0 <= pixels.min() <= pixels.max() < camera.width * camera.height:
        raise ValueError(f"pixels {pixels.min()} … {pixels.max()} leave the {camera.width} × {camera.height} image")
    means, quats, log_scales, opacities = (kernel_array(array) for array in (means, quats, log_scales, opacities))
    projection = project(means, quats, log_scales, opacities, camera, settings)
    tiles = bin_splats(projection, camera.width, camera.height)
    counts = np.zeros(len(pixels), np.int64)
    indptr = np.zeros(len(pixels) + 1, np.int64)
    _run(projection, tiles, pixels, camera.width, settings, indptr, (counts, _NO_ROWS, _NO_WEIGHTS))
    np.cumsum(counts, out=indptr[1:])
    rows, weights = np.empty(indptr[-1], np.int32), np.empty(indptr[-1], np.float32)
    _run(projection, tiles, pixels, camera.width, settings, indptr, (counts, rows, weights))
    return BlendWeights(indptr, rows, weights)


def apply_weights(weights: BlendWeights, features: Float[ndarray, "n d"]) -> Float32[ndarray, "p d"]:
    """W·F: the features of all Gaussians blended at each pixel."""
    features = kernel_array(features)
    blended = np.zeros((len(weights.indptr) - 1, features.shape[1]), np.float32)
    _sum_rows(weights.indptr, weights.rows, weights.weights, features, np.arange(len(blended)), blended)
    return blended


def apply_weights_transposed(weights: BlendWeights, grad: Float[ndarray, "p d"], count: int) -> Float32[ndarray, "n d"]:
    """Wᵀ·grad for N = `count` Gaussians: the gradient of `apply_weights` with respect to the features.

    The result is full: zeros cost less than what an optimiser spends on finding out where they are. The entries
    are regrouped by Gaussian once per `BlendWeights`, so each Gaussian is summed by one thread in pixel order.
    """
    rows, starts, pixels, values = weights._by_row
    result = np.zeros((count, grad.shape[1]), np.float32)
    _sum_rows(starts, pixels, values, kernel_array(grad), rows, result)
    return result


_NO_ROWS, _NO_WEIGHTS = np.empty(0, np.int32), np.empty(0, np.float32)


def _run(
    projection: Projection,
    tiles: TileLists,
    pixels: ndarray,
    width: int,
    settings: RasterSettings,
    indptr: ndarray,
    out: tuple[ndarray, ndarray, ndarray],
) -> None:
    """Count the entries of each pixel, or write them where there is room for them."""
    tile_of_pixel = pixels // width // TILE * tiles.columns + pixels % width // TILE
    order = np.argsort(tile_of_pixel, kind="stable")  # neighbours in one thread: they read the same splats
    with numba.parallel_chunksize(_PIXELS_PER_TASK):
        _walk_pixels(
            (projection.splats, projection.rows),
            (tiles.starts, tiles.splats, tiles.spans),
            (pixels[order], order, tile_of_pixel[order]),
            width,
            settings.as_row(),
            indptr,
            out,
        )


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _walk_pixels(projected, lists, asked, width, constants, indptr, out):
    splats, splat_rows = projected
    starts, pair_splats, spans = lists
    pixels, order, tile_of_pixel = asked
    counts, rows, weights = out[0], out[1], out[2]  # indexed, not unpacked: see project_backward
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    for place in numba.prange(len(pixels)):
        column, line = pixels[place] % width, pixels[place] // width
        left, top = column // TILE * TILE, line // TILE * TILE
        column, line = column - left, line - top
        tile, start = tile_of_pixel[place], indptr[order[place]]
        before, found = np.float32(1), 0
        for pair in range(starts[tile], starts[tile + 1]):
            if line < spans[pair, 0] or line >= spans[pair, 1]:
                continue
            v = pair_splats[pair]
            x, y, base, xx, xy, yy = exponent_of(splats, v, np.float32(left), np.float32(top), min_alpha)
            dx, dy = np.float32(column) - x, np.float32(line) - y
            exponent = base + yy * dy * dy + dx * (xy * dy + xx * dx)
            if exponent < FLOOR:
                continue
            alpha = power_of_two(exponent)
            if alpha < min_alpha:
                continue
            after = before - before * min(alpha, max_alpha)
            if not after > min_transmittance:
                break
            if len(rows):
                rows[start + found], weights[start + found] = splat_rows[v], before - after
            found, before = found + 1, after
        counts[order[place]] = found


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _sum_rows(starts, sources, factors, values, targets, out):
    for place in numba.prange(len(starts) - 1):
        target = targets[place]
        for entry in range(starts[place], starts[place + 1]):
            source, factor = sources[entry], factors[entry]
            for k in range(np.uint64(values.shape[1])):
                out[target, k] += factor * values[source, k]
