"""Which part of its label each pixel of stuff shows, and which parts hang together in one photo's label map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int32, Int64, UInt32
from numpy import ndarray
from scipy import ndimage

_NEIGHBOURS = np.ones((3, 3), bool)


@dataclass(frozen=True)
class PartPixels:
    """Pixels of one photo by region and part: entry k counts those of `parts[k]` in the connected region
    `regions[k]` of its label."""

    regions: Int64[ndarray, " k"]
    """Numbered over all labels of the photo."""
    parts: Int64[ndarray, " k"]
    pixels: Int64[ndarray, " k"]


@dataclass(frozen=True)
class PartMap:
    """One photo, its stuff by part."""

    parts: UInt32[ndarray, "h w"]
    """Part of each pixel; 0 where none is known."""
    counts: PartPixels

    def join_regions(self, count: int) -> Int64[ndarray, " parts"]:
        """Find the least part that each of `count` parts hangs together with, through regions of this photo."""
        joined = np.arange(count)
        while True:
            least = np.full(int(self.counts.regions.max(initial=-1)) + 1, count)
            np.minimum.at(least, self.counts.regions, joined[self.counts.parts])
            before = joined.copy()
            np.minimum.at(joined, self.counts.parts, least[self.counts.regions])
            if (joined == before).all():
                return joined


def build_part_map(
    labels: Int32[ndarray, "h w"], drawn: UInt32[ndarray, "h w"], label_of_part: UInt32[ndarray, " parts"]
) -> PartMap:
    """Give each pixel of a label map the part of the nearest drawn pixel of its label, in its own connected region
    where that shows only one part.

    Args:
        labels: the map; labels that no part has are left alone.
        drawn: part of the nearest point in each pixel; 0 = none or a thing.
        label_of_part: label of each part.
    """
    parts = np.zeros(labels.shape, np.uint32)
    seeds = np.where((drawn > 0) & (label_of_part[drawn] == labels), drawn, 0).astype(np.uint32)
    regions, found, pixels, count = [], [], [], 0
    for label in np.unique(label_of_part[np.unique(seeds[seeds > 0])]).tolist():
        inside = labels == label
        window = ndimage.find_objects(inside.astype(np.uint8))[0]
        numbers, size, of_window = _fill_label(inside[window], seeds[window])
        parts[window][inside[window]] = of_window[inside[window]]
        pairs, areas = np.unique(
            numbers[inside[window]].astype(np.int64) << 32 | of_window[inside[window]], return_counts=True
        )
        regions.append((pairs >> 32) - 1 + count)
        found.append(pairs & 0xFFFFFFFF)
        pixels.append(areas)
        count += size
    empty = np.zeros(0, np.int64)
    return PartMap(parts, PartPixels(*(np.concatenate([empty, *column]) for column in (regions, found, pixels))))


def _fill_label(
    inside: Bool[ndarray, "h w"], seeds: UInt32[ndarray, "h w"]
) -> tuple[Int32[ndarray, "h w"], int, UInt32[ndarray, "h w"]]:
    """Connected regions of one label from 1 on, how many there are, and the part of each of its pixels."""
    regions = np.empty(inside.shape, np.int32)
    count = int(ndimage.label(inside, _NEIGHBOURS, output=regions))
    seeds = np.where(inside, seeds, 0).astype(np.uint32)
    kinds = np.unique(seeds[seeds > 0])
    if len(kinds) == 1:
        return regions, count, np.full(inside.shape, kinds[0], np.uint32)
    rows, columns = ndimage.distance_transform_edt(seeds == 0, return_distances=False, return_indices=True)
    parts = seeds[rows, columns]
    highest, lowest = np.zeros(count + 1, np.uint32), np.full(count + 1, np.iinfo(np.uint32).max, np.uint32)
    seeded = seeds > 0
    np.maximum.at(highest, regions[seeded], seeds[seeded])
    np.minimum.at(lowest, regions[seeded], seeds[seeded])
    single = (highest == lowest)[regions]
    return regions, count, np.where(single, highest[regions], parts)
