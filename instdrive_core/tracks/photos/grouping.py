"""Moving masks that belong to one thing: parts that touch and go the same way, and pieces in time that share paths."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64
from numpy import ndarray
from scipy.ndimage import binary_dilation
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from instdrive_core.tracks.photos.feature_paths import FeaturePaths
from instdrive_core.tracks.photos.region_votes import RegionLinks

TOUCH = 2
"""Pixels by which masks may lie apart and still touch."""
_SAME_WAY, _SAME_SHARE = 1.5, 0.25
"""Pixels, or share of the way, by which parts of one thing may differ from photo to photo."""
_SHARED_PATHS = 3
"""Paths that pieces of one thing have in common."""


def group_strands(
    paths: FeaturePaths, links: RegionLinks, moving: Bool[ndarray, " s"], maps: Sequence[Int32[ndarray, "_ _"]]
) -> list[Int64[ndarray, " r"]]:
    """Group the regions of moving strands by the thing that they show; each group's regions in order of time.

    Args:
        paths: paths through the photos.
        links: masks and strands.
        moving: strands that move.
        maps: label map of each photo.
    """
    strands = np.flatnonzero(moving)
    regions = {int(strand): np.flatnonzero(links.strands == strand) for strand in strands}
    pairs = [pair for pair in combinations(regions, 2) if _belong_together(*pair, regions, paths, links, maps)]
    if not len(strands):
        return []
    places = {strand: place for place, strand in enumerate(regions)}
    rows, columns = ([places[pair[end]] for pair in pairs] for end in (0, 1))
    joined = coo_array((np.ones(len(pairs)), (rows, columns)), shape=(len(strands), len(strands)))
    count, things = connected_components(joined, directed=False)
    groups = [
        np.concatenate([regions[strand] for strand in regions if things[places[strand]] == k]) for k in range(count)
    ]
    return [group[np.argsort(links.photos[group], kind="stable")] for group in groups]


def _belong_together(
    one: int,
    other: int,
    regions: dict[int, ndarray],
    paths: FeaturePaths,
    links: RegionLinks,
    maps: Sequence[Int32[ndarray, "_ _"]],
) -> bool:
    mine, theirs = (_find_owners(paths, links, regions[strand]) for strand in (one, other))
    if len(np.intersect1d(mine, theirs)) >= _SHARED_PATHS:
        return True
    by_photo = [{int(links.photos[region]): int(links.labels[region]) for region in regions[s]} for s in (one, other)]
    shared = sorted(by_photo[0].keys() & by_photo[1].keys())
    if not shared:
        return False
    alike = [
        _touch(maps[photo], by_photo[0][photo], by_photo[1][photo])
        and _go_alike(_find_flow(paths, mine, photo), _find_flow(paths, theirs, photo))
        for photo in shared
    ]
    return 2 * sum(alike) > len(shared)


def _find_owners(paths: FeaturePaths, links: RegionLinks, regions: ndarray) -> Int64[ndarray, " p"]:
    return np.unique(paths.owners[np.isin(links.region_of_entry, regions)])


def _touch(labels: Int32[ndarray, "h w"], one: int, other: int) -> bool:
    grown = binary_dilation(labels == one, iterations=TOUCH)
    return bool((grown & (labels == other)).any())


def _find_flow(paths: FeaturePaths, rows: ndarray, photo: int) -> Float64[ndarray, "2"] | None:
    """Median way of paths from a photo to the next, pixels; None where none goes on."""
    owners = paths.owners
    entries = np.flatnonzero((paths.photos == photo) & np.isin(owners, rows))
    entries = entries[entries + 1 < len(owners)]
    entries = entries[owners[entries + 1] == owners[entries]]
    steps = (paths.places[entries + 1] - paths.places[entries]).astype(np.float64)
    return np.median(steps, axis=0) if len(entries) else None


def _go_alike(one: ndarray | None, other: ndarray | None) -> bool:
    if one is None or other is None:
        return False
    difference = float(np.linalg.norm(one - other))
    return difference < max(_SAME_WAY, _SAME_SHARE * float(max(np.linalg.norm(one), np.linalg.norm(other))))
