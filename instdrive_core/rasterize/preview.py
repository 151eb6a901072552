"""What the editor shows: colour, alpha, depth and the splat that a click selects, in one pass."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float, Float32, Int32
from numpy import ndarray

from instdrive_core.rasterize.bin import PIXELS, TILE, bin_splats
from instdrive_core.rasterize.blend import STRIDE, TILES_PER_TASK, any_alive, open_tile
from instdrive_core.rasterize.fragment import FAST, FLOOR, exponent_of, power_of_two
from instdrive_core.rasterize.layout import kernel_array
from instdrive_core.rasterize.project import DEPTH, OPACITY, project
from instdrive_core.rasterize.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera


@dataclass(frozen=True)
class PickRule:
    """Which splat a pixel stands for.

    The nearest splat that is solid enough wins. Where it carries too little of what the pixel shows (a floater in
    front), or where no splat is solid, the one at median visible depth wins: the first at which half of the
    pixel's blended weight is reached. A pixel without solid splats stands for nothing unless it is half covered.
    """

    min_opacity: float = 0.3
    """Opacity from which a splat is solid."""
    min_alpha: float = 0.2
    """α′ from which its fragment is."""
    min_share: float = 0.5
    """Share of the pixel's blended weight that the nearest solid splat must carry."""
    min_coverage: float = 0.5
    """Blended weight from which a pixel without solid splats stands for its median splat."""


DEFAULT_PICK_RULE = PickRule()


@dataclass(frozen=True)
class Preview:
    """One frame."""

    color: Float32[ndarray, "h w 3"]
    """Σ w·colour: premultiplied by alpha."""
    alpha: Float32[ndarray, "h w"]
    depth: Float32[ndarray, "h w"]
    """Expected depth Σ w·z / Σ w in metres along the viewing axis; 0 where nothing is drawn."""
    winner: Int32[ndarray, "h w"]
    """Row of the splat that a click selects, -1 for none."""


def preview(
    means: Float[ndarray, "n 3"],
    quats: Float[ndarray, "n 4"],
    log_scales: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    colors: Float[ndarray, "n 3"],
    camera: Camera,
    settings: RasterSettings = DEFAULT_SETTINGS,
    rule: PickRule = DEFAULT_PICK_RULE,
) -> Preview:
    """Draw N Gaussians (arguments as for `render`) and find the splat that each pixel stands for."""
    means, quats, log_scales, opacities, colors = (
        kernel_array(array) for array in (means, quats, log_scales, opacities, colors)
    )
    projection = project(means, quats, log_scales, opacities, camera, settings)
    tiles = bin_splats(projection, camera.width, camera.height)
    shape = (camera.height, camera.width)
    result = Preview(
        np.empty((*shape, 3), np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.float32),
        np.empty(shape, np.int32),
    )
    with numba.parallel_chunksize(TILES_PER_TASK):
        _preview(
            (projection.splats, projection.rows, colors),
            (tiles.starts, tiles.splats, tiles.spans, tiles.columns),
            settings.as_row(),
            np.array([rule.min_opacity, rule.min_alpha, rule.min_share, rule.min_coverage], np.float32),
            (result.color, result.alpha, result.depth, result.winner),
        )
    return result


_BATCH = 16
"""Splats staged at once; after each batch a finished tile is left."""
_ROWS = tuple(STRIDE * np.uint64(row) for row in range(10))
_TRANSMITTANCE, _WEIGHT, _ALPHA, _X, _Y, _WINNER, _WINNER_WEIGHT, _GOAL, _DEPTH, _COLORS = _ROWS
_SCRATCH = int(_COLORS + np.uint64(3) * STRIDE)
# Winners are kept as 1 + place in the tile's list, exact in float32 up to 2²⁴ splats per tile; 0 = none yet.


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _stage(staged, splats, rows, channels, pair_splats, start, stop, left, top, min_alpha):
    """Copy what a batch of splats needs: its cache misses overlap here, not where each splat waits for the last.

    A staged splat is the six numbers of `exponent_of`, its depth and its channels.
    """
    for pair in range(start, stop):
        i, v = pair - start, np.uint64(pair_splats[pair])
        x, y, base, xx, xy, yy = exponent_of(splats, v, left, top, min_alpha)
        staged[i, 0], staged[i, 1], staged[i, 2] = x, y, base
        staged[i, 3], staged[i, 4], staged[i, 5] = xx, xy, yy
        staged[i, 6] = splats[v, DEPTH]
        row = np.uint64(rows[v])
        for channel in range(np.uint64(channels.shape[1])):
            staged[i, np.uint64(7) + channel] = channels[row, channel]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _fragments(scratch, splat, first, last, constants):
    """Alphas and weights of one splat's fragments, and the transmittance behind them."""
    x, y, base, xx, xy, yy = splat[0], splat[1], splat[2], splat[3], splat[4], splat[5]
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    for q in range(first, last):
        dx, dy = scratch[_X + q] - x, scratch[_Y + q] - y
        alpha = power_of_two(max(base + yy * dy * dy + dx * (xy * dy + xx * dx), FLOOR))
        alpha = min(alpha, max_alpha) if alpha >= min_alpha else np.float32(0)
        before = scratch[_TRANSMITTANCE + q]
        after = before - before * alpha
        goes_on = after > min_transmittance
        scratch[_ALPHA + q] = alpha
        scratch[_WEIGHT + q] = before - after if goes_on else np.float32(0)
        scratch[_TRANSMITTANCE + q] = after if goes_on else -abs(before)


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _claim(scratch, first, last, number, solid_alpha):
    """Make this splat the winner of the pixels that have none and where its fragment is solid and blended."""
    for q in range(first, last):
        weight = scratch[_WEIGHT + q]
        wins = scratch[_ALPHA + q] >= solid_alpha and weight > np.float32(0) and scratch[_WINNER + q] == np.float32(0)
        scratch[_WINNER + q] = number if wins else scratch[_WINNER + q]
        scratch[_WINNER_WEIGHT + q] = weight if wins else scratch[_WINNER_WEIGHT + q]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _reach_goal(scratch, first, last, number):
    """Make this splat the winner of the pixels whose transmittance falls to the goal with it, and finish them."""
    for q in range(first, last):
        behind = scratch[_TRANSMITTANCE + q]
        wins = scratch[_WEIGHT + q] > np.float32(0) and behind <= scratch[_GOAL + q]
        scratch[_WINNER + q] = number if wins else scratch[_WINNER + q]
        scratch[_TRANSMITTANCE + q] = np.float32(-1) if wins else behind


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _walk_tile(scratch, staged, arrays, lists, start, stop, left, top, constants, rule, median):
    """Blend a tile's splats; the first solid one claims each pixel. The second walk (`median`) finds median splats."""
    splats, rows, colors = arrays
    _, pair_splats, spans, _ = lists
    for batch in range(start, stop, np.uint64(_BATCH)):
        end = min(batch + np.uint64(_BATCH), stop)
        _stage(staged, splats, rows, colors, pair_splats, batch, end, left, top, constants[2])
        for pair in range(batch, end):
            first, last = np.uint64(spans[pair, 0]) * np.uint64(TILE), np.uint64(spans[pair, 1]) * np.uint64(TILE)
            number = np.float32(np.int64(pair - start + np.uint64(1)))
            splat = staged[pair - batch]
            _fragments(scratch, splat, first, last, constants)
            if median:
                _reach_goal(scratch, first, last, number)
                continue
            if splats[np.uint64(pair_splats[pair]), OPACITY] >= rule[0]:
                _claim(scratch, first, last, number, rule[1])
            for channel in range(np.uint64(4)):
                value, place = splat[np.uint64(6) + channel], _DEPTH + channel * STRIDE
                for q in range(first, last):
                    scratch[place + q] += scratch[_WEIGHT + q] * value
        if not any_alive(scratch, _TRANSMITTANCE):
            break


@numba.njit(cache=True, error_model="numpy")
def _write_tile(scratch, left, top, images):
    """Copy a blended tile into the frame."""
    color, alpha, depth, _ = images
    height, width = alpha.shape
    for y in range(top, min(top + TILE, height)):
        for x in range(left, min(left + TILE, width)):
            q = (y - top) * TILE + x - left
            total = np.float32(1) - abs(scratch[np.int64(_TRANSMITTANCE) + q])
            alpha[y, x] = total
            depth[y, x] = scratch[np.int64(_DEPTH) + q] / total if total > 0 else np.float32(0)
            for channel in range(3):
                color[y, x, channel] = scratch[np.int64(_COLORS) + channel * np.int64(STRIDE) + q]


@numba.njit(cache=True, error_model="numpy")
def _set_goals(scratch, rule):
    """Judge the winners; restart the pixels that the median splat has to decide, and tell whether there are any."""
    undecided = False
    for q in range(PIXELS):
        total = np.float32(1) - abs(scratch[np.int64(_TRANSMITTANCE) + q])
        winner = scratch[np.int64(_WINNER) + q]
        floating = winner > 0 and scratch[np.int64(_WINNER_WEIGHT) + q] < rule[2] * total
        asks = floating or (winner == 0 and total >= rule[3])
        scratch[np.int64(_GOAL) + q] = np.float32(1) - np.float32(0.5) * total
        scratch[np.int64(_TRANSMITTANCE) + q] = np.float32(1) if asks else np.float32(-1)
        undecided = undecided or asks
    return undecided


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _preview(arrays, lists, constants, rule, images):
    starts, columns, winner = lists[0], lists[3], images[3]
    height, width = winner.shape
    for tile in numba.prange(len(starts) - 1):
        left, top = tile % columns * TILE, tile // columns * TILE
        start, stop = np.uint64(starts[tile]), np.uint64(starts[tile + 1])
        scratch, staged = np.zeros(_SCRATCH, np.float32), np.empty((_BATCH, 10), np.float32)
        open_tile(scratch, _TRANSMITTANCE, _X, _Y, width - left, height - top)
        x, y = np.float32(left), np.float32(top)
        _walk_tile(scratch, staged, arrays, lists, start, stop, x, y, constants, rule, False)
        _write_tile(scratch, left, top, images)
        if _set_goals(scratch, rule):
            _walk_tile(scratch, staged, arrays, lists, start, stop, x, y, constants, rule, True)
        for line in range(top, min(top + TILE, height)):
            for column in range(left, min(left + TILE, width)):
                number = np.int64(scratch[np.int64(_WINNER) + (line - top) * TILE + column - left])
                if number == 0:
                    winner[line, column] = -1
                else:
                    winner[line, column] = arrays[1][lists[1][starts[tile] + number - 1]]
