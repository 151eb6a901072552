"""The bijection between 24-bit IDs and RGB8 colours that viewer and selection share (InstDrive, sec. 3.4).

An ID is multiplied by an odd constant near 2^24 / golden ratio (neighbouring IDs land far apart on a line), and the
product is laid out along a Z-order curve through the RGB cube. Both steps are invertible; ID 0 (none) is black.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8, UInt32
from numpy import ndarray

ID_LIMIT = 1 << 24
MULTIPLIER = 0x9E3779
INVERSE = pow(MULTIPLIER, -1, ID_LIMIT)


def colors_from_ids(ids: UInt32[ndarray, "*n"]) -> UInt8[ndarray, "*n 3"]:
    """Compute the RGB8 colour of each ID. Raises ValueError for IDs of 2^24 or more."""
    ids = np.asarray(ids, np.uint64)
    if ids.size and ids.max() >= ID_LIMIT:
        raise ValueError(f"ID {ids.max()} does not fit the 24-bit colour map (limit {ID_LIMIT - 1})")
    curve = ids * np.uint64(MULTIPLIER) % np.uint64(ID_LIMIT)
    colors = np.zeros((*ids.shape, 3), np.uint8)
    for bit in range(24):
        value = ((curve >> np.uint64(23 - bit)) & np.uint64(1)).astype(np.uint8)
        colors[..., bit % 3] |= value << np.uint8(7 - bit // 3)
    return colors


def ids_from_colors(colors: UInt8[ndarray, "*n 3"]) -> UInt32[ndarray, "*n"]:
    """Compute the ID of each RGB8 colour; the inverse of `colors_from_ids`."""
    colors = np.asarray(colors, np.uint8)
    curve = np.zeros(colors.shape[:-1], np.uint64)
    for bit in range(24):
        value = (colors[..., bit % 3] >> np.uint8(7 - bit // 3)) & np.uint8(1)
        curve |= value.astype(np.uint64) << np.uint64(23 - bit)
    return (curve * np.uint64(INVERSE) % np.uint64(ID_LIMIT)).astype(np.uint32)
