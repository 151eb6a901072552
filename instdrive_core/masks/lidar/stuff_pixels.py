"""Which pieces of walls, plants and the backdrop hang together in a photo: all that `merge_into_regions` asks."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int32, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.masks.annotated.part_maps import PartPixels
from instdrive_core.masks.lidar.cluster_kind import BACKDROP, VEGETATION, WALL

JOINED = (WALL, VEGETATION, BACKDROP)
"""Kinds whose pieces photos join. Facades are no such kind: along a street, all houses of a side would be one."""
_NEIGHBOURS = np.ones((3, 3), bool)


def count_stuff_pixels(labels: Int32[ndarray, "h w"], kinds: UInt32[ndarray, " i"]) -> PartPixels:
    """Count the pixels of each ID of a joined kind in each connected region of its kind.

    Args:
        labels: an ID per pixel; those that `kinds` has no kind of, negative ones too, are left out.
        kinds: kind of each wide ID (`cluster_kind`).
    """
    wide = (labels >= 0) & (labels < len(kinds))
    kind = np.where(wide, kinds[np.where(wide, labels, 0)], 0)
    regions, parts, pixels, count = [], [], [], 0
    for each in JOINED:
        numbers = np.zeros(labels.shape, np.int32)
        ndimage.label(kind == each, _NEIGHBOURS, output=numbers)
        inside = numbers > 0
        keys, areas = np.unique(numbers[inside].astype(np.int64) << 32 | labels[inside], return_counts=True)
        regions.append((keys >> 32) - 1 + count)
        parts.append(keys & 0xFFFFFFFF)
        pixels.append(areas)
        count += int(numbers.max())
    empty = np.zeros(0, np.int64)
    return PartPixels(*(np.concatenate([empty, *column]) for column in (regions, parts, pixels)))
