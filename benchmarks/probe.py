"""What this machine can do at most, and how much a frame asks of it.

`share_forward` of a benchmark is (evaluations of the frame / seconds of the forward pass) / `measure_pixel_rate()`:
1 would be a rasterizer that projects, sorts, bins and moves memory in no time.
"""

from __future__ import annotations

import time

import numba
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from benchmarks.workload import Workload
from instdrive_core.rasterize.kernels.bin import TILE
from instdrive_core.rasterize.kernels.blend import allocate_aligned_zeros
from instdrive_core.rasterize.kernels.fragment import FAST, FLOOR, power_of_two
from instdrive_core.rasterize.kernels.project import (
    CONIC_XX,
    CONIC_XY,
    CONIC_YY,
    MEAN_X,
    MEAN_Y,
    POWER_LIMIT,
    Projection,
    project,
)
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS
from instdrive_core.rasterize.kernels.simd import (
    add_scaled,
    choose,
    fill_lanes,
    greatest,
    least,
    load,
    load_block,
    magnitude,
    store_block,
)
from instdrive_core.scene.camera import Camera

_SPLATS = 256
_VALUES = 12  # depth, RGB and 8 features
_ROUNDS = 20
_ROW = np.uint64(TILE)
# A splat: the exponent at dx = 0 and its slope for sixteen rows, mean x, xx, then the values.
_SLOPE, _X, _XX, _FIRST, _SPLAT = (np.uint64(place) for place in (16, 32, 33, 34, 48))


def measure_pixel_rate(seconds: float = 1.0) -> float:
    """Gaussian-pixel evaluations per second at best, with `numba.get_num_threads()` threads.

    Each thread blends a few hundred splats that cover all of one tile, staged beforehand, so that everything lies in
    the nearest caches: exponent, exponential, alpha test, transmittance, weight and the sums of RGB, 8 features and
    depth, with the arithmetic of the forward pass. The best of many rounds within `seconds` counts.
    """
    threads = numba.get_num_threads()
    constants = DEFAULT_SETTINGS.to_row()
    sums = np.zeros((threads, TILE * TILE * _VALUES + TILE), np.float32)
    splats = _covering_splats()
    _blend_rounds(splats, 1, constants, sums)
    best, stop = np.inf, time.perf_counter() + seconds
    while time.perf_counter() < stop:
        start = time.perf_counter()
        _blend_rounds(splats, _ROUNDS, constants, sums)
        best = min(best, time.perf_counter() - start)
    return threads * _ROUNDS * _SPLATS * TILE * TILE / best


def count_evaluations(workload: Workload, camera: Camera) -> int:
    """Gaussian-pixel evaluations that a frame of a workload needs with tight bounds (see `count_tight_evaluations`)."""
    projection = project(
        workload.means, workload.quats, workload.log_scales, workload.opacities, camera, DEFAULT_SETTINGS
    )
    return count_tight_evaluations(projection, camera.width, camera.height)


def count_tight_evaluations(projection: Projection, width: int, height: int) -> int:
    """Gaussian-pixel evaluations with tight bounds, whether or not pixels are finished early.

    The pixel rows that the bounding box of a splat's visible ellipse (alpha ≥ min_alpha) crosses, times sixteen for
    each tile column that it touches: 18.0, 30.4 and 90.8 million on W1, W2 and W3 in state init, first camera.
    """
    (first_x, end_x), (first_y, end_y) = _boxes(projection, width, height)
    rows, tiles = end_y - first_y, (end_x + TILE - 1) // TILE - first_x // TILE
    return int((TILE * rows * tiles)[(rows > 0) & (end_x > first_x)].sum())


def count_visible_fragments(projection: Projection, width: int, height: int) -> int:
    """Pixel centres inside the ellipses themselves: what no rasterizer can do without, but for finished pixels."""
    boxes = np.concatenate(_boxes(projection, width, height)).T
    counts = np.zeros(len(boxes), np.int64)
    _count_inside(projection.splats.astype(np.float64), np.ascontiguousarray(boxes), counts)
    return int(counts.sum())


def _boxes(projection: Projection, width: int, height: int) -> tuple[ndarray, ndarray]:
    """First and end pixel index of each splat's visible ellipse, along x and along y."""
    spans = []
    for axis, size in ((0, width), (1, height)):
        mean = projection.splats[:, MEAN_X + axis].astype(np.float64) - 0.5
        reach = np.sqrt(projection.splats[:, POWER_LIMIT] * projection.covariances[:, 2 * axis])
        first = np.clip(np.ceil(mean - reach), 0, size)
        spans.append(np.stack([first, np.clip(np.floor(mean + reach) + 1, first, size)]).astype(np.int64))
    return spans[0], spans[1]


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _count_inside(splats, boxes, counts):
    for v in numba.prange(len(splats)):
        xx, xy, yy, limit = splats[v, CONIC_XX], splats[v, CONIC_XY], splats[v, CONIC_YY], splats[v, POWER_LIMIT]
        inside = 0
        for y in range(boxes[v, 2], boxes[v, 3]):
            dy = y + 0.5 - splats[v, MEAN_Y]
            for x in range(boxes[v, 0], boxes[v, 1]):
                dx = x + 0.5 - splats[v, MEAN_X]
                inside += dx * (xx * dx + 2 * xy * dy) + yy * dy * dy <= limit
        counts[v] = inside


def _covering_splats() -> Float[ndarray, " k"]:
    """Faint staged splats that leave every pixel of the tile unfinished."""
    splats = np.zeros((_SPLATS, int(_SPLAT)), np.float32)
    splats[:, : int(_SLOPE)] = -0.8  # eighths of a power of two: alpha is about 0.012
    splats[:, int(_X)], splats[:, int(_XX)] = 7.5, -1e-4
    splats[:, int(_FIRST) : int(_FIRST) + _VALUES] = 0.5
    return splats.reshape(-1)


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _blend_rounds(splats, rounds, constants, sums):
    for thread in numba.prange(len(sums)):
        staged = allocate_aligned_zeros(len(splats))
        for k in range(len(splats)):
            staged[k] = splats[k]
        tile = allocate_aligned_zeros(sums.shape[1])
        for k in range(TILE):
            tile[len(tile) - TILE + k] = k
        for _ in range(rounds):
            _blend_tile(tile, staged, np.uint64(len(splats)), constants)
        for k in range(len(tile)):
            sums[thread, k] = tile[k]


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _blend_tile(tile, staged, length, constants):
    """Every splat at every pixel, the transmittance and the twelve sums of a row in registers."""
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    zero = np.float32(0)
    columns = load(tile, np.uint64(len(tile)) - _ROW)
    for row in range(_ROW):
        target = row * _ROW * np.uint64(_VALUES)
        before = fill_lanes(np.float32(1))
        totals = load_block(12, tile, target, _ROW)
        for at in range(np.uint64(0), length, _SPLAT):
            dx = columns - staged[at + _X]
            slope = staged[at + _SLOPE + row] + staged[at + _XX] * dx
            raw = power_of_two(greatest(staged[at + row] + dx * slope, FLOOR))
            after = before - before * choose(raw >= min_alpha, least(raw, max_alpha), zero)
            goes_on = after > min_transmittance
            totals = add_scaled(totals, choose(goes_on, before - after, zero), staged, at + _FIRST)
            before = choose(goes_on, after, zero - magnitude(before))
        store_block(tile, target, _ROW, totals)
