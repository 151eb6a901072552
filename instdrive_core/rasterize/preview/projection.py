"""Projection of a preview's splats, sixteen rows at a time: what `kernels.project` computes, and their colours.

Both in one walk over the rows, which reads each number once and writes a cache line for each visible splat.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int32, UInt32
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.bin import SLACK, TILE
from instdrive_core.rasterize.kernels.fragment import EIGHTH
from instdrive_core.rasterize.kernels.lane_math import exponentiate, round_down, round_up, take_logarithm, take_root
from instdrive_core.rasterize.kernels.lane_shuffles import (
    load_columns,
    pack_pairs,
    store_records,
    store_up_to,
    take_member,
)
from instdrive_core.rasterize.kernels.project import FLAGS, camera_to_row
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.kernels.simd import (
    WIDTH,
    choose,
    fill_lanes,
    greatest,
    least,
    load,
    pack_lane_bits,
    store,
    store_block,
    unpack_lane_bits,
)
from instdrive_core.rasterize.preview.chunk import BOXES, CHUNK, COLUMNS, new_chunk
from instdrive_core.rasterize.preview.colors import ColorSource, color_chunk
from instdrive_core.rasterize.preview.splats import (
    AT_A,
    AT_B,
    AT_BASE,
    AT_C,
    AT_COV_XX,
    AT_COV_XY,
    AT_INSTANCE,
    AT_LIMIT,
    AT_OPACITY,
    AT_ROW,
    AT_VALUES,
    AT_X,
    AT_Y,
    MANY,
    NAMELESS,
    NO_INSTANCES,
    NO_NAMES,
    ProjectedSplats,
)
from instdrive_core.scene.camera import Camera

_LANES, _ROWS = np.uint64(WIDTH), np.uint64(CHUNK)
_CHUNKS_PER_TASK = 16
_SLACK = np.float32(1e-4)
"""Slack of exponents, so that rounding never loses a tile with a fragment that is drawn."""


def project_splats(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    log_scales: Float32[ndarray, "n 3"],
    opacities: Float32[ndarray, " n"],
    camera: Camera,
    settings: RasterSettings,
    source: ColorSource,
    workspace: Workspace,
    names: Int32[ndarray, " k"] = NO_NAMES,
    instances: UInt32[ndarray, " m"] = NO_INSTANCES,
) -> ProjectedSplats:
    """Project, cull and colour splats; culled are those that `project` culls, and those that hold no pixel centre.

    Colours are RGB (≥ 0) along the direction from the camera; `names` and `instances` are those of `ProjectedSplats`.
    The arrays are the workspace's.
    """
    found = ProjectedSplats(len(means), workspace, names, instances)
    project_part(means, quats, log_scales, opacities, camera, settings, source, found)
    return found


def project_part(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    log_scales: Float32[ndarray, "n 3"],
    opacities: Float32[ndarray, " n"],
    camera: Camera,
    settings: RasterSettings,
    source: ColorSource,
    found: ProjectedSplats,
) -> None:
    """Do what `project_splats` does for some rows, into their part of `found`; `source` is that of these rows."""
    arrays = means, quats, log_scales, opacities
    rest = len(means) % int(_LANES)
    last = tuple(_fill_up(array[len(means) - rest :]) for array in arrays)
    view = np.append(camera_to_row(camera), camera.position.astype(np.float32))
    constants = np.append(settings.to_row(), np.float32(np.log2(settings.min_alpha) / 8))
    written = found.lines, found.depths, found.tiles.view(np.float32).reshape(-1)
    harmonics, turned, recolored = source.to_arguments()
    called = found.first_row, found.names, found.instances
    _project(arrays, last, view, constants, harmonics, turned, recolored, written, *called)


def _fill_up(rows: ndarray) -> ndarray:
    """Fill up fewer than sixteen rows with zeros."""
    full = np.zeros((int(_LANES), *rows.shape[1:]), np.float32)
    full[: len(rows)] = rows
    return full


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FLAGS)
def _project_chunk(means, quats, log_scales, opacities, start, groups, view, constants, chunk, done):
    """Project groups of sixteen rows from `start` on into a chunk's, behind those that are `done`.

    All in one function: each that is called would count references to these arrays, which takes longer than the sums.
    """
    columns, boxes, directions, seen = chunk.columns, chunk.boxes, chunk.directions, chunk.seen
    near, low_pass, min_alpha = constants[0], constants[1], constants[2]
    fx, fy, cx, cy, width, height = view[12], view[13], view[14], view[15], view[16], view[17]
    zero, one, two, half = np.float32(0), np.float32(1), np.float32(2), np.float32(0.5)
    scale, side = half * EIGHTH, np.float32(TILE)
    for number in range(done, done + groups):
        first, at = start + (number - done) * _LANES, number * COLUMNS
        place, opacity = load_columns(3, means, first * np.uint64(3)), load(opacities, first)
        mx, my, mz = take_member(place, 0), take_member(place, 1), take_member(place, 2)
        z = view[6] * mx + view[7] * my + view[8] * mz + view[11]
        visible = (z > near) & (opacity >= min_alpha)
        seen[number] = np.uint64(0)
        if pack_lane_bits(visible) == np.uint16(0):
            continue
        x = view[0] * mx + view[1] * my + view[2] * mz + view[9]
        y = view[3] * mx + view[4] * my + view[5] * mz + view[10]
        rz = one / z
        px, py = fx * x * rz + cx, fy * y * rz + cy

        # J · R_view: the 2 × 3 map from world offsets to pixel offsets
        tx, ty = least(greatest(x * rz, view[18]), view[19]), least(greatest(y * rz, view[20]), view[21])
        j00, j02, j11, j12 = fx * rz, zero - fx * tx * rz, fy * rz, zero - fy * ty * rz
        t00, t01, t02 = j00 * view[0] + j02 * view[6], j00 * view[1] + j02 * view[7], j00 * view[2] + j02 * view[8]
        t10, t11, t12 = j11 * view[3] + j12 * view[6], j11 * view[4] + j12 * view[7], j11 * view[5] + j12 * view[8]

        # times rotation and scale: the covariance is U·Uᵀ
        turn, sizes = load_columns(4, quats, first * np.uint64(4)), load_columns(3, log_scales, first * np.uint64(3))
        qw, qx, qy, qz = take_member(turn, 0), take_member(turn, 1), take_member(turn, 2), take_member(turn, 3)
        double = two / (qw * qw + qx * qx + qy * qy + qz * qz)
        dx, dy, dz = double * qx, double * qy, double * qz
        r00, r01, r02 = one - dy * qy - dz * qz, dx * qy - dz * qw, dx * qz + dy * qw
        r10, r11, r12 = dx * qy + dz * qw, one - dx * qx - dz * qz, dy * qz - dx * qw
        r20, r21, r22 = dx * qz - dy * qw, dy * qz + dx * qw, one - dx * qx - dy * qy
        lx, ly, lz = take_member(sizes, 0), take_member(sizes, 1), take_member(sizes, 2)
        visible = visible & (lx >= lx) & (ly >= ly) & (lz >= lz)  # numbers
        sx, sy, sz = exponentiate(lx), exponentiate(ly), exponentiate(lz)
        u00, u10 = sx * (t00 * r00 + t01 * r10 + t02 * r20), sx * (t10 * r00 + t11 * r10 + t12 * r20)
        u01, u11 = sy * (t00 * r01 + t01 * r11 + t02 * r21), sy * (t10 * r01 + t11 * r11 + t12 * r21)
        u02, u12 = sz * (t00 * r02 + t01 * r12 + t02 * r22), sz * (t10 * r02 + t11 * r12 + t12 * r22)
        xx, yy = u00 * u00 + u01 * u01 + u02 * u02, u10 * u10 + u11 * u11 + u12 * u12
        xy = u00 * u10 + u01 * u11 + u02 * u12

        # |U0 × U1|² equals xx·yy - xy² without the cancellation that makes thin splats singular in float32
        c0, c1, c2 = u01 * u12 - u02 * u11, u02 * u10 - u00 * u12, u00 * u11 - u01 * u10
        sharp = c0 * c0 + c1 * c1 + c2 * c2
        determinant = sharp + low_pass * (xx + yy + low_pass)
        xx, yy = xx + low_pass, yy + low_pass
        if constants[5] > zero:
            opacity = opacity * take_root(sharp / determinant)
            visible = visible & (opacity >= min_alpha)
        limit = two * take_logarithm(opacity / min_alpha)
        reach_x, reach_y = take_root(limit * xx), take_root(limit * yy)
        visible = visible & (fill_lanes(np.float32(1e30)) > determinant)
        visible = visible & (px + reach_x > half) & (fill_lanes(width - half) > px - reach_x)
        visible = visible & (py + reach_y > half) & (fill_lanes(height - half) > py - reach_y)
        px, py = px - half, py - half
        held, left, columns_held = _find_tiles(px, reach_x, width - one)
        visible = visible & held
        held, top, rows_held = _find_tiles(py, reach_y, height - one)
        visible = visible & held
        seen[number] = np.uint64(pack_lane_bits(visible))
        if seen[number] == np.uint64(0):
            continue

        a, slope = take_root(scale * (yy / determinant)), xy / yy
        b, c = zero - a * slope, take_root(scale / yy)
        shape = a, b, c, slope, xy / xx, scale * limit + _SLACK
        # Bits of the four tiles from the first on: these are all for most splats, and the ellipse may miss a corner.
        corner_x, corner_y = left * side - px, top * side - py
        two_columns, two_rows = columns_held >= two, rows_held >= two
        tiles = _note_reached(fill_lanes(zero), visible, corner_x, corner_y, shape, one)
        tiles = _note_reached(tiles, visible & two_columns, corner_x + side, corner_y, shape, two)
        tiles = _note_reached(tiles, visible & two_rows, corner_x, corner_y + side, shape, two * two)
        both = visible & two_columns & two_rows
        tiles = _note_reached(tiles, both, corner_x + side, corner_y + side, shape, two * two * two)
        few = (two >= columns_held) & (two >= rows_held)
        tiles = choose(few, tiles, choose(visible, fill_lanes(MANY), fill_lanes(zero)))
        store_block(boxes, number * BOXES, _LANES, pack_pairs(left, top, tiles, fill_lanes(zero)))
        store(columns, at + AT_A * _LANES, a)
        store(columns, at + AT_B * _LANES, b)
        store(columns, at + AT_C * _LANES, c)
        store(columns, at + AT_BASE * _LANES, scale * limit + constants[6])
        store(columns, at + AT_X * _LANES, px)
        store(columns, at + AT_Y * _LANES, py)
        store(columns, at + AT_OPACITY * _LANES, opacity)
        store(columns, at + AT_LIMIT * _LANES, limit)
        store(columns, at + AT_VALUES * _LANES, z)
        store(columns, at + AT_COV_XX * _LANES, xx)
        store(columns, at + AT_COV_XY * _LANES, xy)
        store(directions, number * _LANES, mx - view[22])
        store(directions, number * _LANES + _ROWS, my - view[23])
        store(directions, number * _LANES + _ROWS + _ROWS, mz - view[24])


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FLAGS)
def _find_tiles(center, reach, last):
    """Along one axis: whether there is a pixel centre within reach, the first tile with one, and how many have any."""
    zero, one, tile = np.float32(0), np.float32(1), np.float32(1 / TILE)
    reach = reach + SLACK
    low, high = round_up(greatest(center - reach, zero)), round_down(least(center + reach, last))
    held, first = high >= low, round_down(low * tile)
    return held, choose(held, first, zero), choose(held, round_down(high * tile) - first + one, zero)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FLAGS)
def _note_reached(tiles, wanted, left, upper, shape, bit):
    """Add a tile's bit where its ellipse of visible alpha reaches it; `left` and `upper` lead from the mean to it."""
    a, b, c, along_x, along_y, limit = shape
    zero, span = np.float32(0), np.float32(TILE - 1)
    right, lower = left + span, upper + span
    # If the mean lies outside, the exponent is largest on the side that is nearest to it along one of the axes.
    near_x, near_y = greatest(left, least(right, zero)), greatest(upper, least(lower, zero))
    best_x = least(greatest(along_x * near_y, left), right)
    best_y = least(greatest(along_y * near_x, upper), lower)
    u, v = a * near_x + b * best_y, c * best_y
    other_u, other_v = a * best_x + b * near_y, c * near_y
    nearest = least(u * u + v * v, other_u * other_u + other_v * other_v)
    return tiles + choose(wanted & (limit >= nearest), fill_lanes(bit), fill_lanes(zero))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FLAGS)
def _write_chunk(chunk, start, count, first_row, names, instances, lines, depths, boxes):
    """Write a chunk's rows from `start` on, of which there are `count`."""
    columns, rows, packed, seen = chunk.columns, chunk.columns.view(np.int32), chunk.boxes, chunk.seen
    zero = np.float32(0)
    for group in range((count + _LANES - np.uint64(1)) // _LANES):
        first, at, at_boxes = start + group * _LANES, group * COLUMNS, group * BOXES
        held, visible = np.int64(min(_LANES, count - group * _LANES)), seen[group]
        shown = unpack_lane_bits(np.uint16(visible))
        store_up_to(held, depths, first, choose(shown, load(columns, at + AT_VALUES * _LANES), zero))
        if visible == np.uint64(0):
            store_up_to(2 * held, boxes, first * np.uint64(2), fill_lanes(zero))
            store_up_to(2 * held - 16, boxes, first * np.uint64(2) + _LANES, fill_lanes(zero))
            continue
        store_up_to(2 * held, boxes, first * np.uint64(2), load(packed, at_boxes))
        store_up_to(2 * held - 16, boxes, first * np.uint64(2) + _LANES, load(packed, at_boxes + _LANES))
        store(columns, at + AT_INSTANCE * _LANES, fill_lanes(zero))
        for lane in range(np.uint64(held)):
            name = np.int64(names[first + lane]) if len(names) else np.int64(first_row + first + lane)
            rows[at + AT_ROW * _LANES + lane] = np.int32(name)
            if name < 0:
                columns[at + AT_OPACITY * _LANES + lane] = NAMELESS
            elif len(instances):
                columns[at + AT_INSTANCE * _LANES + lane] = np.float32(instances[name])
        store_records(columns, at, visible, lines, first * _LANES)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath=FLAGS)
def _project(arrays, last, view, constants, harmonics, turned, recolored, written, first_row, names, instances):
    lines, depths, boxes = written
    count, values = np.uint64(len(depths)), harmonics[1].shape[1]
    chunks, flat, rest = (len(depths) + CHUNK - 1) // CHUNK, lines.reshape(-1), harmonics[1].reshape(-1)
    means, quats, log_scales, opacities = arrays[0].reshape(-1), arrays[1].reshape(-1), arrays[2].reshape(-1), arrays[3]
    part = last[0].reshape(-1), last[1].reshape(-1), last[2].reshape(-1), last[3]
    dc, matrices, rotations = harmonics[0].reshape(-1), recolored[1].reshape(-1), turned[1].reshape(-1)
    remembered = harmonics[4].reshape(-1)
    for task in numba.prange((chunks + _CHUNKS_PER_TASK - 1) // _CHUNKS_PER_TASK):
        room = new_chunk(values)
        for number in range(np.uint64(task * _CHUNKS_PER_TASK), np.uint64(min((task + 1) * _CHUNKS_PER_TASK, chunks))):
            start = number * _ROWS
            here = min(_ROWS, count - start)
            whole = here // _LANES
            _project_chunk(means, quats, log_scales, opacities, start, whole, view, constants, room, np.uint64(0))
            if whole * _LANES < here:
                _project_chunk(*part, np.uint64(0), np.uint64(1), view, constants, room, whole)
            color_chunk(
                *(room, start, here, dc, rest, harmonics[2], harmonics[3], remembered),
                *(harmonics[5], turned[0], rotations, recolored[0], matrices),
            )
            _write_chunk(room, start, here, first_row, names, instances, flat, depths, boxes)
