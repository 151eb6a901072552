"""The blending weights of chosen pixels as a sparse matrix: with frozen geometry a rendered feature map is W·F.

Training instance features then needs no rasterizing: `apply_weights` is the forward pass of the chosen pixels,
that of the `transpose_weights` weights the gradient.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32, Int64
from numpy import ndarray

from instdrive_core.rasterize.kernels.fragment import FAST
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.pixel_walk import (
    PIXELS_PER_TASK,
    PixelLists,
    find_next_fragment,
    list_pixels,
    list_projected_pixels,
    locate_pixel,
)
from instdrive_core.rasterize.kernels.project import Projection
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera


@dataclass(frozen=True)
class BlendWeights:
    """A P × N matrix of M weights, pixel by pixel; within a pixel nearest first."""

    indptr: Int64[ndarray, " p+1"]
    """Pixel p owns the entries indptr[p] … indptr[p + 1]."""
    rows: Int32[ndarray, " m"]
    """Gaussians."""
    weights: Float32[ndarray, " m"]

    def select_pixels(self, kept: Bool[ndarray, " p"]) -> BlendWeights:
        """Copy the matrix without the other pixels."""
        counts = np.diff(self.indptr)
        entries = np.repeat(kept, counts)
        indptr = np.concatenate([[0], np.cumsum(counts[kept])]).astype(np.int64)
        return BlendWeights(indptr, self.rows[entries], self.weights[entries])

    def replace_pixels(self, replaced: Bool[ndarray, " p"], others: BlendWeights) -> BlendWeights:
        """Copy the matrix with other entries for some pixels: those of `others`, in the same order."""
        counts = np.diff(self.indptr)
        old, counts[replaced] = np.repeat(~replaced, counts), np.diff(others.indptr)
        new = np.repeat(replaced, counts)
        rows, weights = np.empty(len(new), np.int32), np.empty(len(new), np.float32)
        rows[~new], weights[~new] = self.rows[old], self.weights[old]
        rows[new], weights[new] = others.rows, others.weights
        return BlendWeights(np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), rows, weights)


def compute_blend_weights(
    means: Float[ndarray, "n 3"],
    quats: Float[ndarray, "n 4"],
    log_scales: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    camera: Camera,
    pixels: Int[ndarray, " p"],
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> BlendWeights:
    """Compute which Gaussians `render` blends at the given pixels (row-major, flat), and with which weights.

    Raises:
        ValueError: a pixel is outside the image.
    """
    return _weigh(list_pixels(means, quats, log_scales, opacities, camera, pixels, settings), settings)


def weigh_projected(
    projection: Projection, camera: Camera, pixels: Int[ndarray, " p"], settings: RasterSettings = DEFAULT_SETTINGS
) -> BlendWeights:
    """Compute the weights at the given pixels of Gaussians that are projected already; rows are those projected.

    Raises:
        ValueError: a pixel is outside the image.
    """
    return _weigh(list_projected_pixels(projection, camera, pixels), settings)


def _weigh(lists: PixelLists, settings: RasterSettings) -> BlendWeights:
    """Walk once with some room for each pixel, and again over those that need more."""
    count = len(lists.pixels)
    counts, indptr = np.zeros(count, np.int64), np.zeros(count + 1, np.int64)
    room = min(_ROOM, _MOST_ROOM // max(count, 1))
    starts = np.arange(count + 1) * room
    first = np.empty(starts[-1], np.int32), np.empty(starts[-1], np.float32)
    _run(lists, settings, starts, (counts, *first), 0)
    np.cumsum(counts, out=indptr[1:])
    rows, weights = np.zeros(indptr[-1], np.int32), np.zeros(indptr[-1], np.float32)
    _copy_entries(starts, indptr, *first, rows, weights)
    if counts.max(initial=0) > room:
        _run(lists, settings, indptr, (counts, rows, weights), room + 1)
    return BlendWeights(indptr, rows, weights)


def apply_weights(weights: BlendWeights, features: Float[ndarray, "n d"]) -> Float32[ndarray, "p d"]:
    """Blend the features of all Gaussians at each pixel: W·F."""
    features = to_kernel_array(features)
    blended = np.empty((len(weights.indptr) - 1, features.shape[1]), np.float32)
    _sum_rows(weights.indptr, weights.rows, weights.weights, features, blended)
    return blended


def transpose_weights(weights: BlendWeights, count: int) -> BlendWeights:
    """Transpose the weights of N = `count` Gaussians: Wᵀ, each one's entries in the order of the pixels.

    `apply_weights` of it turns a gradient of pixels into the features' gradient.
    """
    indptr = np.zeros(count + 1, np.int64)
    pixels, values = np.empty_like(weights.rows), np.empty_like(weights.weights)
    _transpose(weights.indptr, weights.rows, weights.weights, indptr, pixels, values)
    return BlendWeights(indptr, pixels, values)


def compact_weights(weights: BlendWeights, count: int) -> tuple[Int64[ndarray, " v"], BlendWeights]:
    """Drop the rows without weights of N = `count` Gaussians; returns the others, rising, and their weights."""
    used = np.zeros(count, np.bool_)
    used[weights.rows] = True
    rows = np.flatnonzero(used)
    place = np.empty(count, np.int32)
    place[rows] = np.arange(len(rows), dtype=np.int32)
    return rows, BlendWeights(weights.indptr, place[weights.rows], weights.weights)


_ROOM = 96
"""Entries of a pixel for which there is room in the first walk: most have fewer."""
_MOST_ROOM = 1 << 23
"""Entries of all pixels for which there is: 64 MiB."""


def _run(
    lists: PixelLists, settings: RasterSettings, indptr: ndarray, out: tuple[ndarray, ndarray, ndarray], least: int
) -> None:
    """Count the entries of each pixel, and write those for which there is room; pixels with fewer than `least` wait."""
    with numba.parallel_chunksize(PIXELS_PER_TASK):
        _walk_pixels(*lists.to_arguments(), settings.to_row(), indptr, out, least)


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _walk_pixels(projected, lists, asked, width, constants, indptr, out, least):
    splats, splat_rows = projected
    starts, pair_splats, spans = lists
    pixels, order, tile_of_pixel = asked
    counts, rows, weights = out[0], out[1], out[2]  # indexed, not unpacked: see project_backward
    for number in numba.prange(len(pixels)):
        if counts[order[number]] < least:
            continue
        place, tile = locate_pixel(pixels[number], width), tile_of_pixel[number]
        start, end = indptr[order[number]], indptr[order[number] + 1]
        before, found, stop = np.float32(1), 0, starts[tile + 1]
        pair, after = find_next_fragment(splats, pair_splats, spans, starts[tile], stop, place, before, constants)
        while pair < stop:
            if start + found < end:
                rows[start + found], weights[start + found] = splat_rows[pair_splats[pair]], before - after
            found, before = found + 1, after
            pair, after = find_next_fragment(splats, pair_splats, spans, pair + 1, stop, place, before, constants)
        counts[order[number]] = found


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _copy_entries(from_starts, to_starts, from_rows, from_weights, rows, weights):
    for pixel in numba.prange(len(to_starts) - 1):
        shift, room = from_starts[pixel] - to_starts[pixel], from_starts[pixel + 1] - from_starts[pixel]
        for entry in range(to_starts[pixel], min(to_starts[pixel + 1], to_starts[pixel] + room)):
            rows[entry], weights[entry] = from_rows[entry + shift], from_weights[entry + shift]


@numba.njit(cache=True, error_model="numpy")
def _transpose(starts, rows, weights, indptr, pixels, values):
    """A counting sort by row."""
    for row in rows:
        indptr[row + 1] += 1
    for row in range(len(indptr) - 1):
        indptr[row + 1] += indptr[row]
    place = indptr[:-1].copy()
    for pixel in range(len(starts) - 1):
        for entry in range(starts[pixel], starts[pixel + 1]):
            row = rows[entry]
            pixels[place[row]], values[place[row]] = pixel, weights[entry]
            place[row] += 1


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _sum_rows(starts, sources, factors, values, out):
    columns = np.uint64(values.shape[1])
    for target in numba.prange(len(starts) - 1):
        for k in range(columns):
            out[target, k] = 0
        for entry in range(np.uint64(starts[target]), np.uint64(starts[target + 1])):
            source, factor = np.uint64(sources[entry]), factors[entry]
            for k in range(columns):
                out[target, k] += factor * values[source, k]
