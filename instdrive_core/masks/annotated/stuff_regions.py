"""Parts of stuff that are one object: they hang together in the label maps of most photos that show both.

Groups of parts merge while the mean agreement of two groups is at least one half, the best first. A photo has a say in
proportion to the pixels that it shows of the smaller group; pixels of both groups agree in it if they lie in one
connected region of their label. One photo in which two sides of a street meet far away thus joins nothing that other
photos keep apart, and a facade cut by a pole in one photo stays whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int64, UInt32
from numpy import ndarray

from instdrive_core.masks.annotated.part_maps import PartPixels

LEAST_AGREEMENT = 0.5


def merge_into_regions(
    photos: Sequence[PartPixels], label_of_part: UInt32[ndarray, " parts"]
) -> Int64[ndarray, " parts"]:
    """Find the least part of the region that each part belongs to."""
    regions = np.arange(len(label_of_part))
    for label in np.unique(label_of_part[1:]).tolist():
        members = np.flatnonzero(label_of_part == label)
        table, photo_of_column = _count_pixels(photos, members)
        seen = np.flatnonzero(table.any(axis=1))
        if len(seen) > 1:
            regions[members[seen]] = members[seen[_link_groups(table[seen], photo_of_column)]]
    return regions


def _count_pixels(
    photos: Sequence[PartPixels], members: Int64[ndarray, " m"]
) -> tuple[Float64[ndarray, "m columns"], Int64[ndarray, " columns"]]:
    """Pixels of each part in each region of each photo, and the photo of each region; regions of a photo follow one
    another."""
    rows, columns, pixels, photo_of_column = [], [], [], []
    for number, photo in enumerate(photos):
        ours = np.isin(photo.parts, members)
        shown, place = np.unique(photo.regions[ours], return_inverse=True)
        rows.append(np.searchsorted(members, photo.parts[ours]))
        columns.append(place + len(photo_of_column))
        pixels.append(photo.pixels[ours])
        photo_of_column += [number] * len(shown)
    table = np.zeros((len(members), len(photo_of_column)))
    np.add.at(table, (np.concatenate(rows), np.concatenate(columns)), np.concatenate(pixels))
    return table, np.array(photo_of_column, np.int64)


def _link_groups(
    table: Float64[ndarray, "n columns"], photo_of_column: Int64[ndarray, " columns"]
) -> Int64[ndarray, " n"]:
    """Merge rows while two agree; the least row of each one's group."""
    table, group = table.copy(), np.arange(len(table))
    starts = np.flatnonzero(np.diff(photo_of_column, prepend=-1))
    areas = np.add.reduceat(table, starts, axis=1)
    agreement = np.stack([_agree(table, areas, row, starts) for row in range(len(table))])
    np.fill_diagonal(agreement, -1)
    while agreement.max() >= LEAST_AGREEMENT:
        kept, gone = sorted(np.unravel_index(int(agreement.argmax()), agreement.shape))
        group[group == gone] = kept
        for sums in (table, areas):
            sums[kept] += sums[gone]
            sums[gone] = 0
        agreement[kept] = agreement[:, kept] = _agree(table, areas, int(kept), starts)
        agreement[gone] = agreement[:, gone] = -1
        agreement[kept, kept] = -1
    return group


def _agree(
    table: Float64[ndarray, "n columns"],
    areas: Float64[ndarray, "n photos"],
    row: int,
    starts: Int64[ndarray, " photos"],
) -> Float64[ndarray, " n"]:
    """Agreement of one group with every group; -1 where no photo shows both."""
    weights = np.minimum(areas, areas[row])
    together = np.add.reduceat(table * table[row], starts, axis=1) / np.maximum(areas * areas[row], 1)
    seen = weights.sum(axis=1)
    return np.where(seen > 0, (weights * together).sum(axis=1) / np.maximum(seen, 1), -1.0)
