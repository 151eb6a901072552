"""Colours of a preview's visible splats, recoloured, sixteen rows at a time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numba
import numpy as np
from jaxtyping import Float32, Int32, UInt16
from llvmlite import ir
from numba.core import types
from numpy import ndarray

from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.rasterize.kernels.lane_shuffles import interleave_lanes, load_columns, load_turned, take_member
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.simd import (
    WIDTH,
    LaneBlock,
    build_block,
    choose,
    find_lowest_bit,
    intrinsic,
    load,
    load_block,
    prefetch,
    store_block,
    unpack_lane_bits,
)
from instdrive_core.rasterize.kernels.view_colors import fill_basis
from instdrive_core.rasterize.preview.chunk import CHUNK, COLUMNS
from instdrive_core.rasterize.preview.splats import AT_COLOR

_LANES = np.uint64(WIDTH)
_AHEAD = np.uint64(1)
"""So many groups ahead harmonics are fetched."""
_CUBIC = 15
"""Coefficients above the constant of harmonics of degree 3."""
_ROWS = np.uint64(CHUNK)
_DARKEST = float(np.finfo(np.float32).min)


class RememberedColors:
    """Colours of n splats as they are seen from one place, as far as they are known."""

    def __init__(self, count: int) -> None:
        self.colors = np.empty((count, 3), np.float32)
        """RGB; undefined where it is not known."""
        self.known = np.zeros(-(-count // WIDTH), np.uint16)
        """Bits of those that are known among each sixteen rows."""

    def forget(self) -> None:
        """Know none of them any more."""
        self.known[:] = 0


@dataclass(frozen=True)
class ColorSource:
    """Harmonics of splats and their recolouring."""

    sh_dc: Float32[ndarray, "n 3"]
    sh_rest: Float32[ndarray, "n k 3"]
    frames: Int32[ndarray, " n"]
    """Index into `rotations` of the one that turns a splat's harmonics; empty where none does."""
    rotations: Float32[ndarray, "f 3 3"]
    """world_from_frame."""
    entries: UInt16[ndarray, " n"]
    """Entry of the colour palette; 0 changes nothing."""
    matrices: Float32[ndarray, "p 3 4"]
    """[A | b] of each entry: max(A c + b, 0) is shown for c."""
    sources: Int32[ndarray, " n"] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Row of `sh_dc` and `sh_rest` that each splat takes; empty where they lie in the same order."""
    remembered: RememberedColors = field(default_factory=lambda: RememberedColors(0))
    """Colours of these rows that are known, or of no rows, as where there are `sources`; new ones are written there."""
    known: bool = False
    """Whether `sh_dc` holds the colours themselves, from any direction."""

    def to_arguments(self) -> tuple[tuple[ndarray, ...], tuple[ndarray, ...], tuple[ndarray, ...]]:
        """Write the arrays as the kernels take them."""
        tone = (0.0, 1.0, _DARKEST) if self.known else (0.5, Y0, 0.0)
        return (
            (
                *(to_kernel_array(self.sh_dc), to_kernel_array(self.sh_rest), self.sources),
                *(np.array(tone, np.float32), self.remembered.colors, self.remembered.known),
            ),
            (self.frames, to_kernel_array(self.rotations)),
            (np.require(self.entries, np.uint16, ["C", "W"]), to_kernel_array(self.matrices)),
        )


def know_colors(colors: Float32[ndarray, "n 3"]) -> ColorSource:
    """Make a source of splats whose colours are known."""
    count, none = len(colors), np.zeros(0, np.int32)
    same = np.eye(3, 4, dtype=np.float32)[None]
    rest, entries = np.zeros((count, 0, 3), np.float32), np.zeros(count, np.uint16)
    return ColorSource(colors, rest, none, np.eye(3, dtype=np.float32)[None], entries, same, known=True)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def color_chunk(chunk, start, count, dc, rest, sources, tone, remembered, known, frames, rotations, entries, matrices):
    """Write RGB of the visible rows among `count` from `start` on into the chunk's columns."""
    columns, directions, places, values = chunk.columns, chunk.directions, chunk.places, chunk.basis
    width, basis, fresh = np.uint64(3 * len(values)), values.reshape(-1), chunk.fresh
    groups = (count + _LANES - np.uint64(1)) // _LANES
    if not _recall(chunk.seen, start, groups, remembered, known, columns, fresh):
        return
    if width:
        if len(frames):
            _turn_offsets(start, count, fresh, frames, rotations, directions)
        _normalize(directions)
        fill_basis(_ROWS, directions.reshape((3, CHUNK)), values)
    for group in range(groups):
        visible, first, ahead = fresh[group], start + group * _LANES, min(group + _AHEAD, groups - np.uint64(1))
        if visible == np.uint64(0):
            continue
        at, shown = group * COLUMNS + AT_COLOR * _LANES, first + find_lowest_bit(visible)
        soon, first_ahead = fresh[ahead], start + ahead * _LANES
        for lane in range(_LANES):
            row = first + lane if (visible >> lane) & np.uint64(1) else shown
            j = np.uint64(sources[row]) if len(sources) else row
            places[lane] = j * width
            for channel in range(np.uint64(3)):
                columns[at + channel * _LANES + lane] = tone[0] + tone[1] * dc[np.uint64(3) * j + channel]
            if width:
                row = first_ahead + lane if (soon >> lane) & np.uint64(1) else shown
                place = width * (np.uint64(sources[row]) if len(sources) else row)
                prefetch(rest, place)
                prefetch(rest, place + width // np.uint64(3))
                prefetch(rest, place + np.uint64(2) * width // np.uint64(3))
                prefetch(rest, place + width - np.uint64(1))
        if width == np.uint64(3 * _CUBIC):
            colors, at_basis = load_block(3, columns, at, _LANES), group * _LANES
            colors = _add_harmonics(colors, load_turned(rest, places, np.uint64(0)), basis, at_basis, 0, 0)
            colors = _add_harmonics(colors, load_turned(rest, places, np.uint64(16)), basis, at_basis, 16, 0)
            # The rest begins at 32 and is read with three that are known, so that nothing beyond the last row is read.
            colors = _add_harmonics(colors, load_turned(rest, places, np.uint64(29)), basis, at_basis, 29, 3)
            store_block(columns, at, _LANES, colors)
        else:
            for lane in range(_LANES):
                for k in range(np.uint64(len(values))):
                    value, coefficient = values[k, group * _LANES + lane], places[lane] + k * np.uint64(3)
                    for channel in range(np.uint64(3)):
                        columns[at + channel * _LANES + lane] += value * rest[coefficient + channel]
    _recolor(start, count, fresh, entries, matrices, columns)
    for group in range(groups):
        at = group * COLUMNS + AT_COLOR * _LANES
        for place in range(at, at + np.uint64(3) * _LANES):
            columns[place] = max(columns[place], tone[2])
    _remember(start, groups, columns, fresh, remembered, known)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _recall(seen, start, groups, remembered, known, columns, fresh):
    """Write the colours that are remembered for all visible rows of a group; `fresh` gets the bits of other groups'
    visible rows. Returns whether there are any."""
    rows, any_fresh = np.uint64(len(remembered) // 3), False
    for group in range(groups):
        first, visible = start + group * _LANES, seen[group]
        fresh[group] = visible
        if first + _LANES <= rows and np.uint64(known[first // _LANES]) & visible == visible:
            colors = load_columns(3, remembered, first * np.uint64(3))
            store_block(columns, group * COLUMNS + AT_COLOR * _LANES, _LANES, colors)
            fresh[group] = np.uint64(0)
        any_fresh |= fresh[group] != np.uint64(0)
    return any_fresh


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _remember(start, groups, columns, fresh, remembered, known):
    """Write down the colours of the fresh rows, beside those of their group that are known."""
    rows = np.uint64(len(remembered) // 3)
    for group in range(groups):
        first, at = start + group * _LANES, group * COLUMNS + AT_COLOR * _LANES
        if fresh[group] and first + _LANES <= rows:
            place, new = first * np.uint64(3), np.uint16(fresh[group])
            red, green, blue = load(columns, at), load(columns, at + _LANES), load(columns, at + _LANES + _LANES)
            old = known[first // _LANES] & ~new
            if old:
                kept, before = unpack_lane_bits(np.uint16(old)), load_columns(3, remembered, place)
                red, green = choose(kept, take_member(before, 0), red), choose(kept, take_member(before, 1), green)
                blue = choose(kept, take_member(before, 2), blue)
            store_block(remembered, place, _LANES, interleave_lanes(build_block(red, green, blue)))
            known[first // _LANES] |= new


@intrinsic(prefer_literal=True)
def _add_harmonics(typingctx, colors, coefficients, basis, place, number, skipped):
    """Add basis value · coefficient for sixteen coefficients (of red, green, blue, red …) from `number` on, without the
    first `skipped`; both are literals."""
    if not isinstance(number, types.IntegerLiteral) or not isinstance(skipped, types.IntegerLiteral):
        return None
    first, left_out = number.literal_value, skipped.literal_value

    def codegen(context, builder, signature, args):
        sums = [builder.extract_value(args[0], channel) for channel in range(3)]
        data = context.make_array(signature.args[2])(context, builder, args[2]).data
        vector = sums[0].type
        for k in range(left_out, WIDTH):
            value, channel = divmod(first + k, 3)
            at = builder.gep(data, [builder.add(args[3], ir.IntType(64)(value * CHUNK))])
            factor = builder.load(builder.bitcast(at, vector.as_pointer()), align=4)
            product = builder.fmul(factor, builder.extract_value(args[1], k))
            sums[channel] = builder.fadd(sums[channel], product)
        block = args[0]
        for channel in range(3):
            block = builder.insert_value(block, sums[channel], channel)
        return block

    return LaneBlock(3)(colors, coefficients, basis, types.uint64, number, skipped), codegen


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=True)
def _turn_offsets(start, count, fresh, frames, rotations, directions):
    """Turn offsets from the camera into each splat's own frame."""
    for row in range(count):
        f = np.uint64(9) * np.uint64(frames[start + row])
        if (fresh[row // _LANES] >> (row % _LANES)) & np.uint64(1):
            x, y, z = directions[row], directions[row + _ROWS], directions[row + _ROWS + _ROWS]
            for axis in range(np.uint64(3)):
                m = f + axis
                turned = rotations[m] * x + rotations[m + np.uint64(3)] * y + rotations[m + np.uint64(6)] * z
                directions[row + axis * _ROWS] = turned


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=True)
def _normalize(directions):
    for row in range(_ROWS):
        x, y, z = directions[row], directions[row + _ROWS], directions[row + _ROWS + _ROWS]
        scale = np.float32(1) / np.sqrt(max(x * x + y * y + z * z, np.float32(1e-12)))
        directions[row], directions[row + _ROWS], directions[row + _ROWS + _ROWS] = x * scale, y * scale, z * scale


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=True)
def _recolor(start, count, fresh, entries, matrices, columns):
    for row in range(count):
        entry, group, lane = np.uint64(entries[start + row]), row // _LANES, row % _LANES
        if entry and (fresh[group] >> lane) & np.uint64(1):
            at = group * COLUMNS + AT_COLOR * _LANES + lane
            red, green, blue = columns[at], columns[at + _LANES], columns[at + _LANES + _LANES]
            for channel in range(np.uint64(3)):
                m = np.uint64(12) * entry + np.uint64(4) * channel
                mixed = matrices[m] * red + matrices[m + np.uint64(1)] * green + matrices[m + np.uint64(2)] * blue
                columns[at + channel * _LANES] = mixed + matrices[m + np.uint64(3)]
