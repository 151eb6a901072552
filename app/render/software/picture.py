"""Turns a preview drawn on the CPU into the viewport's RGBA8 picture.

On a GPU, present.frag, mask.frag and outline.frag do the same.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int32, UInt8, UInt32
from numpy import ndarray

from instdrive_app.preferences.instance_colors import paint_safe_colors
from instdrive_app.render.picture_colors import DEPTH_RAMP, HOVERED_LINE, SELECTED_LINE, SELECTED_TINT
from instdrive_core.instances.colormap import ID_LIMIT, INVERSE, MULTIPLIER, colors_from_ids
from instdrive_core.rasterize.kernels.fragment import FAST
from instdrive_core.scene.selection import Flag

_NO_TINT = (0.0, 0.0, 0.0, 0.0)
_LOW_BITS = 16
_SELECTED = np.uint8(Flag.SELECTED)
_PIXELS_PER_TASK = 1 << 14
_OPAQUE = np.int32(-(1 << 24))
"""255 in the last of four bytes."""


def paint_color(color: Float32[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 4"]:
    """Convert RGB in [0, 1], clipped, to bytes."""
    picture = np.empty((*color.shape[:2], 4), np.uint8)
    _write_color(color.reshape(-1), picture.reshape(-1).view(np.int32))
    return picture


def paint_depth(
    depth: Float32[ndarray, "h w"], alpha: Float32[ndarray, "h w"], depth_range: tuple[float, float]
) -> UInt8[ndarray, "h w 4"]:
    """Paint depth (metres) with the colour ramp, logarithmic between two depths; black where almost nothing is."""
    picture = np.empty((*depth.shape, 4), np.uint8)
    ramp, ends = np.array(DEPTH_RAMP, np.float32), np.array(depth_range, np.float32)
    _write_depth(depth, alpha, ramp, ends, picture)
    return picture


def paint_ids(winner: Int32[ndarray, "h w"], ids: UInt32[ndarray, " n"]) -> UInt8[ndarray, "h w 4"]:
    """Paint each pixel with the colour of its ID (instance or codeword), black for none.

    IDs above 24 bits share the colours of their low 24 bits, like on a GPU.
    """
    picture = np.empty((*winner.shape, 4), np.uint8)
    _write_ids(winner, ids, _LOW_COLORS, _HIGH_COLORS, picture)
    return picture


def paint_safe_ids(winner: Int32[ndarray, "h w"], ids: UInt32[ndarray, " n"]) -> UInt8[ndarray, "h w 4"]:
    """Paint each pixel with a colour for its ID that colour-blind eyes tell apart, black for none."""
    picture = np.zeros((*winner.shape, 4), np.uint8)
    shown = winner >= 0
    picture[shown, :3] = paint_safe_colors(ids)[winner[shown]]
    picture[..., 3] = 255
    return picture


def add_outlines(
    picture: UInt8[ndarray, "h w 4"],
    winner: Int32[ndarray, "h w"],
    flags: UInt8[ndarray, " n"],
    instance_ids: UInt32[ndarray, " n"],
    hovered: int,
    tint: bool,
    thickness: int,
) -> None:
    """Draw lines around selected splats and around the instance `hovered` (0 for none), in place; tint the selected."""
    mask = np.empty(winner.shape, np.uint8)
    _mark(winner, flags, instance_ids, np.uint32(hovered), mask)
    overlays = np.array([SELECTED_LINE, HOVERED_LINE, SELECTED_TINT if tint else _NO_TINT], np.float32)
    _draw_lines(mask, overlays, thickness, picture)


def _build_id_tables() -> tuple[UInt8[ndarray, "65536 3"], UInt8[ndarray, "256 3"]]:
    """Build tables of colours by position on the colour map's curve, for its low 16 bits and for the 8 bits above.

    Every bit of a position is a bit of the colour, so `or` joins the two.
    """
    low = np.arange(1 << _LOW_BITS, dtype=np.uint64)
    high = np.arange(ID_LIMIT >> _LOW_BITS, dtype=np.uint64) << np.uint64(_LOW_BITS)
    ids = [(places * np.uint64(INVERSE) % np.uint64(ID_LIMIT)).astype(np.uint32) for places in (low, high)]
    return colors_from_ids(ids[0]), colors_from_ids(ids[1])


_LOW_COLORS, _HIGH_COLORS = _build_id_tables()


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _to_byte(value):
    """Convert a number in [0, 1], clipped, to 0 … 255."""
    return np.int32(min(max(value, np.float32(0)), np.float32(1)) * np.float32(255) + np.float32(0.5))


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath=FAST)
def _write_color(color, pixels):
    """Write four bytes at once, so that the loop over flat arrays vectorises."""
    for task in numba.prange((len(pixels) + _PIXELS_PER_TASK - 1) // _PIXELS_PER_TASK):
        end = min(len(pixels), (task + 1) * _PIXELS_PER_TASK)
        for pixel in range(np.uint64(task * _PIXELS_PER_TASK), np.uint64(end)):
            red = pixel * np.uint64(3)
            levels = _to_byte(color[red]), _to_byte(color[red + np.uint64(1)]), _to_byte(color[red + np.uint64(2)])
            pixels[pixel] = levels[0] | levels[1] << np.int32(8) | levels[2] << np.int32(16) | _OPAQUE


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _write_depth(depth, alpha, ramp, ends, picture):
    last, span = len(ramp) - 1, np.log(ends[1] / ends[0])
    for y in numba.prange(picture.shape[0]):
        for x in range(np.uint64(picture.shape[1])):
            picture[y, x, 3] = 255
            if alpha[y, x] < np.float32(0.05):
                for channel in range(np.uint64(3)):
                    picture[y, x, channel] = 0
                continue
            place = min(max(np.log(depth[y, x] / ends[0]) / span, np.float32(0)), np.float32(1)) * np.float32(last)
            stop = np.uint64(min(np.int64(place), last - 1))
            share = place - np.float32(stop)
            for channel in range(np.uint64(3)):
                value = ramp[stop, channel] * (np.float32(1) - share) + ramp[stop + np.uint64(1), channel] * share
                picture[y, x, channel] = np.uint8(value * np.float32(255) + np.float32(0.5))


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _write_ids(winner, ids, low_colors, high_colors, picture):
    for y in numba.prange(picture.shape[0]):
        for x in range(np.uint64(picture.shape[1])):
            row = winner[y, x]
            picture[y, x, 3] = 255
            place = np.uint64(ids[np.uint64(row)]) * np.uint64(MULTIPLIER) if row >= 0 else np.uint64(0)
            low, high = place & np.uint64(0xFFFF), (place >> np.uint64(_LOW_BITS)) & np.uint64(0xFF)
            for channel in range(np.uint64(3)):
                picture[y, x, channel] = low_colors[low, channel] | high_colors[high, channel]


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _mark(winner, flags, instance_ids, hovered, mask):
    """Set bit 0 of pixels that stand for a selected splat, bit 1 of those that stand for the hovered instance."""
    for y in numba.prange(mask.shape[0]):
        for x in range(np.uint64(mask.shape[1])):
            marks, row = np.uint8(0), winner[y, x]
            if row >= 0:
                marks |= flags[np.uint64(row)] & _SELECTED
                if hovered != 0 and instance_ids[np.uint64(row)] == hovered:
                    marks |= np.uint8(2)
            mask[y, x] = marks


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _draw_lines(mask, overlays, thickness, picture):
    height, width = mask.shape
    for y in numba.prange(height):
        for x in range(width):
            here, around = mask[y, x], np.uint8(0)
            for step in range(1, thickness + 1):
                around |= mask[y, max(x - step, 0)] | mask[y, min(x + step, width - 1)]
                around |= mask[max(y - step, 0), x] | mask[min(y + step, height - 1), x]
            edge = around & ~here
            if edge & 1:
                overlay = overlays[0]
            elif edge & 2:
                overlay = overlays[1]
            elif here & 1:
                overlay = overlays[2]
            else:
                continue
            for channel in range(3):
                value = overlay[channel] * overlay[3] * np.float32(255) + picture[y, x, channel] * (1 - overlay[3])
                picture[y, x, channel] = np.uint8(value + np.float32(0.5))
