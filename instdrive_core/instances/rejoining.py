"""Parts of one codeword that a gap divides, though they are one thing.

Two pieces that carry one codeword are one object that is seen in part, or two objects whose codewords collided. A piece
that weighs little is hardly ever an object of its own, so it joins across a wide gap, and one that weighs as much as a
car across none. Large flat pieces in one plane (a road behind the shadow of a parked car, a wall behind a tree) join
across gaps that are no longer than they are themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from instdrive_core.instances.cells import Cells
from instdrive_core.instances.neighbors import NeighborForest

_MAX_QUERIES = 512
"""Cells of a component, evenly spread, from which a larger one is looked for."""


@dataclass(frozen=True)
class RejoinConfig:
    """When parts that a gap divides are one object all the same."""

    max_gap: float = 8.0
    """Metres; no gap may be wider."""
    gap_times_support: float = 60.0
    """The gap in metres across which the smaller part joins, times its support (sum of opacities)."""
    flat_extent: float = 4.0
    """Metres: from this length on (two standard deviations) a flat part may join in its plane."""
    flatness: float = 0.12
    """Largest deviation of a flat part from the larger part's plane (root mean square), as a share of its length."""


@dataclass(frozen=True)
class _Shapes:
    """Components as ellipsoids."""

    centers: Float64[ndarray, "c 3"]
    covariances: Float64[ndarray, "c 3 3"]
    lengths: Float64[ndarray, " c"]
    """Two standard deviations along the longest axis, metres."""
    normals: Float64[ndarray, "c 3"]
    """Unit vectors along the shortest axis."""


def rejoin_components(
    components: Int64[ndarray, " m"], cells: Cells, by_group: NeighborForest, min_support: float, config: RejoinConfig
) -> Int64[ndarray, " m"]:
    """Join parts to the nearest larger component of their own group; returns the component of each cell.

    Components with less than `min_support` stay as they are and nothing joins them: what surrounds them knows better.
    """
    support = np.bincount(components, weights=cells.support)
    parts = np.flatnonzero((support >= min_support) & _find_sharing_group(components, cells, support >= min_support))
    if not len(parts):
        return components
    shapes = _fit_shapes(components, cells, support)
    reach, flat = _compute_reach(parts, support, shapes, config)
    distances, nearest = _find_nearest_larger(components, cells, by_group, support, parts, reach, min_support)
    found = np.isfinite(distances)
    parts, flat, gaps, larger = parts[found], flat[found], distances[found], components[nearest[found]]
    weighty = gaps > _compute_gap(support[parts], config)
    apart = _compute_deviation(parts, larger, shapes) > config.flatness * shapes.lengths[parts]
    joins = ~weighty | (flat & ~apart)
    parts, larger = parts[joins], larger[joins]
    owners = np.arange(len(support))
    # From the largest down: what a part joins has its owner by then.
    for place in np.lexsort((parts, -support[parts])):
        owners[parts[place]] = owners[larger[place]]
    return owners[components]


def _find_sharing_group(
    components: Int64[ndarray, " m"], cells: Cells, solid: Bool[ndarray, " c"]
) -> Bool[ndarray, " c"]:
    """Find the components whose group has other solid ones, too."""
    group_of = np.zeros(len(solid), np.int64)
    group_of[components] = cells.groups
    return np.bincount(group_of[solid], minlength=group_of.max() + 1)[group_of] > 1


def _fit_shapes(components: Int64[ndarray, " m"], cells: Cells, support: Float64[ndarray, " c"]) -> _Shapes:
    """Fit ellipsoids to components, weighted by the cells' support."""
    weights = np.maximum(support, 1e-12)

    def mean(values: Float64[ndarray, " m"]) -> Float64[ndarray, " c"]:
        return np.bincount(components, weights=values * cells.support) / weights

    centers = np.stack([mean(cells.positions[:, axis]) for axis in range(3)], axis=1)
    offsets = cells.positions - centers[components]
    covariances = np.empty((len(support), 3, 3))
    for row in range(3):
        for column in range(row + 1):
            covariances[:, row, column] = covariances[:, column, row] = mean(offsets[:, row] * offsets[:, column])
    variances, axes = np.linalg.eigh(covariances)
    return _Shapes(centers, covariances, 2 * np.sqrt(np.maximum(variances[:, 2], 0)), axes[:, :, 0])


def _compute_gap(support: Float64[ndarray, " p"], config: RejoinConfig) -> Float64[ndarray, " p"]:
    return np.minimum(config.max_gap, config.gap_times_support / support)


def _compute_reach(
    parts: Int64[ndarray, " p"], support: Float64[ndarray, " c"], shapes: _Shapes, config: RejoinConfig
) -> tuple[Float64[ndarray, " p"], Bool[ndarray, " p"]]:
    """Compute how far each part looks for a larger one, and which parts are large and flat."""
    lengths = shapes.lengths[parts]
    flat = (lengths >= config.flat_extent) & (_compute_deviation(parts, parts, shapes) <= config.flatness * lengths)
    in_plane = np.where(flat, np.minimum(lengths, config.max_gap), 0)
    return np.maximum(_compute_gap(support[parts], config), in_plane), flat


def _compute_deviation(
    parts: Int64[ndarray, " p"], others: Int64[ndarray, " p"], shapes: _Shapes
) -> Float64[ndarray, " p"]:
    """Compute the root mean square distance of each part from the plane of another, metres."""
    normals = shapes.normals[others]
    own = np.einsum("pi,pij,pj->p", normals, shapes.covariances[parts], normals)
    away = np.einsum("pi,pi->p", normals, shapes.centers[parts] - shapes.centers[others])
    return np.sqrt(np.maximum(own, 0) + away**2)


def _find_nearest_larger(
    components: Int64[ndarray, " m"],
    cells: Cells,
    by_group: NeighborForest,
    support: Float64[ndarray, " c"],
    parts: Int64[ndarray, " p"],
    reach: Float64[ndarray, " p"],
    min_support: float,
) -> tuple[Float64[ndarray, " p"], Int64[ndarray, " p"]]:
    """Find the gap to the nearest component of more support in each part's group (inf = none), and the cell beyond."""
    count = len(support)
    rank_of = np.empty(count, np.int64)
    rank_of[np.lexsort((np.arange(count), -support))] = np.arange(count)
    rank_of[support < min_support] = count
    place_of = np.full(count, -1)
    place_of[parts] = np.arange(len(parts))
    asking = _choose_spread_cells(components, place_of)
    part = place_of[components[asking]]
    distances, found = by_group.find_nearest(
        cells.positions[asking], cells.groups[asking], 1, reach[part], rank_of[components], rank_of[parts[part]]
    )
    order = np.lexsort((found[:, 0], distances[:, 0], part))
    firsts = order[np.unique(part[order], return_index=True)[1]]
    return distances[firsts, 0], found[firsts, 0].astype(np.int64)


def _choose_spread_cells(components: Int64[ndarray, " m"], place_of: Int64[ndarray, " c"]) -> Int64[ndarray, " q"]:
    """Choose at most `_MAX_QUERIES` cells of each component that has a place."""
    mine = np.flatnonzero(place_of[components] >= 0)
    mine = mine[np.argsort(components[mine], kind="stable")]
    sizes = np.bincount(components[mine], minlength=len(place_of))
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    step = -(-sizes // _MAX_QUERIES)
    return mine[(np.arange(len(mine)) - starts[components[mine]]) % step[components[mine]] == 0]
