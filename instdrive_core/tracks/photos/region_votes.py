"""Which masks move: what the paths of the corners in them say, pooled along each mask's way through the photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int8, Int32, Int64
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from instdrive_core.tracks.photos.feature_paths import FeaturePaths

FEWEST_VOTES, LEAST_SHARE = 5, 0.65
"""Moving paths that a mask needs within a window, and of all paths that say something."""
LEAST_SHARE_OF_ALL = 0.45
"""Share of moving paths that a mask needs over all of its photos: it may stand for a while."""
MOST_MOVING_OF_STANDING = 0.3
"""Share of moving paths above which a mask does not surely stand."""
VOTE_WIDTH = 12.0
"""A mask needs a moving path for so many pixels of its width: a few do not speak for a large one."""
WINDOW = 5
"""Photos whose votes are counted together."""
FEWEST_WINDOWS = 2
"""Windows, each a photo later than the one before, that must agree that a mask moves."""
FEWEST_PHOTOS = 3
"""Photos in which a mask must be seen."""
ENOUGH_VOTES, ENOUGH_PHOTOS = 8, 10
"""A mask needs so many moving paths, or so many photos."""
_LINK_SHARE = 0.5
"""Share of the paths of both masks that go on, which two masks must share to be the same thing."""


@dataclass(frozen=True)
class RegionLinks:
    """Masks of one camera's photos, joined to strands: the same thing in several photos."""

    photos: Int32[ndarray, " r"]
    """Photo of each region."""
    labels: Int32[ndarray, " r"]
    """Its label there."""
    areas: Int64[ndarray, " r"]
    """Its pixels there."""
    strands: Int64[ndarray, " r"]
    region_of_entry: Int64[ndarray, " k"]
    """Region that each place of a path lies in, -1 = none."""


def link_regions(paths: FeaturePaths, maps: Sequence[Int32[ndarray, "_ _"]]) -> RegionLinks:
    """Join the masks of following photos that share most of their paths.

    Args:
        paths: paths through the photos.
        maps: label map of each photo, 0 = nothing.
    """
    columns, rows = paths.places.astype(np.int64).T
    labels = np.zeros(len(paths.photos), np.int64)
    for number, labelled in enumerate(maps):
        here = paths.photos == number
        labels[here] = labelled[rows[here], columns[here]]
    keys = paths.photos.astype(np.int64) << 32 | labels
    known, index = np.unique(keys[labels > 0], return_inverse=True)
    region = np.full(len(keys), -1, np.int64)
    region[labels > 0] = index
    owners = paths.owners
    before, after = region[:-1], region[1:]
    both = (owners[:-1] == owners[1:]) & (before >= 0) & (after >= 0)
    count = len(known)
    shared = coo_array((np.ones(both.sum()), (before[both], after[both])), shape=(count, count)).tocsr().tocoo()
    leaving = np.asarray(shared.tocsr().sum(axis=1)).ravel()
    coming = np.asarray(shared.tocsr().sum(axis=0)).ravel()
    row, column = shared.coords
    firm = shared.data > _LINK_SHARE * np.maximum(leaving[row], coming[column])
    links = coo_array((np.ones(firm.sum()), (row[firm], column[firm])), shape=(count, count))
    strands = connected_components(links, directed=False)[1].astype(np.int64)
    photos, names = (known >> 32).astype(np.int32), (known & 0xFFFFFFFF).astype(np.int32)
    areas = np.zeros(count, np.int64)
    for number, labelled in enumerate(maps):
        here = photos == number
        areas[here] = np.bincount(labelled.ravel(), minlength=int(labelled.max()) + 1)[names[here]]
    return RegionLinks(photos, names, areas, strands, region)


def find_moving_strands(paths: FeaturePaths, verdicts: Int8[ndarray, " n"], links: RegionLinks) -> Bool[ndarray, " s"]:
    """Find the strands that move in some window of photos.

    Args:
        paths: paths through the photos.
        verdicts: 1 = moves, -1 = stands, 0 = says nothing.
        links: masks and strands.
    """
    count = int(links.strands.max(initial=-1)) + 1
    agreeing = np.zeros(count, np.int64)
    inside = links.region_of_entry >= 0
    strand = links.strands[links.region_of_entry[inside]]
    photo, owner = paths.photos[inside], paths.owners[inside]
    said = verdicts[owner]
    for start in range(max(1, int(photo.max(initial=0)) - WINDOW + 2)):
        here = (photo >= start) & (photo < start + WINDOW) & (said != 0)
        pairs = np.unique(np.stack([strand[here], owner[here]]), axis=1)
        moved = verdicts[pairs[1]] > 0
        votes = np.bincount(pairs[0][moved], minlength=count)
        total = np.bincount(pairs[0], minlength=count)
        agreeing += (votes >= FEWEST_VOTES) & (votes >= LEAST_SHARE * total)
    all_votes, all_said = tally_strands(paths, verdicts, links)
    sizes = np.maximum(np.bincount(links.strands, minlength=count), 1)
    mean_areas = np.bincount(links.strands, links.areas, count) / sizes
    moving = (agreeing >= FEWEST_WINDOWS) & (all_votes >= LEAST_SHARE_OF_ALL * all_said)
    moving &= all_votes >= np.sqrt(mean_areas) / VOTE_WIDTH
    spans = np.bincount(np.unique(np.stack([links.strands, links.photos]), axis=1)[0], minlength=count)
    return moving & (spans >= FEWEST_PHOTOS) & ((all_votes >= ENOUGH_VOTES) | (spans >= ENOUGH_PHOTOS))


def find_standing_strands(
    paths: FeaturePaths, verdicts: Int8[ndarray, " n"], links: RegionLinks
) -> Bool[ndarray, " s"]:
    """Find the strands that surely stand; the arguments are those of `find_moving_strands`."""
    moved, said = tally_strands(paths, verdicts, links)
    return (said >= FEWEST_VOTES) & (moved < MOST_MOVING_OF_STANDING * said)


def tally_strands(
    paths: FeaturePaths, verdicts: Int8[ndarray, " n"], links: RegionLinks
) -> tuple[Int64[ndarray, " s"], Int64[ndarray, " s"]]:
    """Count, for each strand, the paths in it that move, and those that say something."""
    count = int(links.strands.max(initial=-1)) + 1
    inside = links.region_of_entry >= 0
    pairs = np.stack([links.strands[links.region_of_entry[inside]], paths.owners[inside]])
    pairs = np.unique(pairs[:, verdicts[pairs[1]] != 0], axis=1)
    moved = np.bincount(pairs[0][verdicts[pairs[1]] > 0], minlength=count)
    return moved, np.bincount(pairs[0], minlength=count)
