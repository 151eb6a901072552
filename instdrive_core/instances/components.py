"""Instances as spatial components: Gaussians of one node and one codeword that hang together are one thing.

Nothing in training separates two objects that no photo shows together, so they may share a codeword; space tells them
apart. Gaussians are gathered into small cells, the cells of a (node, codeword) group are joined to near ones by a
k-nearest-neighbour graph whose reach follows the local spacing, and components too small to be objects are given away.
Within an actor nothing is split: its box already says that it is one thing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int64, UInt16, UInt32
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree


@dataclass(frozen=True)
class ComponentConfig:
    """When Gaussians of one codeword are one object."""

    cell_size: float = 0.1
    """Metres; Gaussians of a group in one cell always belong together."""
    neighbors: int = 8
    """Cells that each cell may be joined to."""
    spacing_neighbor: int = 4
    """The local spacing is the distance to the neighbour of this rank."""
    spacing_factor: float = 3.0
    """Two cells are joined up to this many times the geometric mean of their spacings …"""
    max_gap: float = 1.0
    """… and at most this many metres (more where the scene is sparse), …"""
    extent_factor: float = 1.0
    """… plus this many middle standard deviations of the Gaussians on both sides."""
    max_extent: float = 3.0
    """Metres; larger Gaussians count as this large."""
    min_support: float = 4.0
    """A component whose opacities sum to less is a fragment, not an object."""
    absorb_distance: float = 1.5
    """Metres up to which a fragment joins a component of its own codeword (more where the scene is sparse)."""
    vote_distance: float = 0.5
    """Metres up to which neighbours of other codewords vote on a fragment (more where the scene is sparse)."""
    sparse_limit: float = 10.0
    """Metres: far from the cameras Gaussians lie metres apart, and the three distances grow with the scene's local
    spacing, whatever the codewords, up to this."""


DEFAULT_CONFIG = ComponentConfig()


@dataclass(frozen=True)
class _Cells:
    """Gaussians gathered by group and place."""

    of_gaussian: Int64[ndarray, " n"]
    positions: Float64[ndarray, "m 3"]
    groups: Int64[ndarray, " m"]
    """Number of the (node, codeword) pair."""
    nodes: Int64[ndarray, " m"]
    extents: Float64[ndarray, " m"]
    support: Float64[ndarray, " m"]
    scene_spacing: Float64[ndarray, " m"]
    """`spacing_factor` times the local spacing among the node's cells of all codewords, metres."""


def split_components(
    means: Float[ndarray, "n 3"],
    scales: Float[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    codewords: UInt32[ndarray, " n"],
    opacities: Float[ndarray, " n"],
    config: ComponentConfig = DEFAULT_CONFIG,
) -> UInt32[ndarray, " n"]:
    """The instance ID of each Gaussian: 1 for the component of most Gaussians, then falling; 0 = none.

    Args:
        means: metres, in the frame of each Gaussian's node.
        scales: standard deviations in metres.
        nodes: 0 = background, k = actor k - 1; components never reach across nodes.
        codewords: components never join different ones, only fragments below the minimum support do.
        opacities: in [0, 1].
        config: distances and thresholds.

    Fragments join the nearest component of the same codeword, else the instance that most of their neighbours belong
    to, else none. Gaussians without a finite position get none.
    """
    labels = np.zeros(len(means), np.uint32)
    rows = np.flatnonzero(np.isfinite(means).all(axis=1) & np.isfinite(scales).all(axis=1))
    if not len(rows):
        return labels
    cells = _gathered(means[rows], scales[rows], nodes[rows], codewords[rows], opacities[rows], config)
    components = _connected(cells, config)
    support = np.bincount(components, weights=cells.support)
    kept = support >= config.min_support
    owners = np.where(kept, np.arange(len(support)), -1)
    _absorb_by_codeword(owners, components, kept, cells, config)
    _absorb_by_vote(owners, components, kept, cells, config)
    labels[rows] = _numbered_by_size(owners[components][cells.of_gaussian])
    return labels


def _gathered(
    means: ndarray, scales: ndarray, nodes: ndarray, codewords: ndarray, opacities: ndarray, config: ComponentConfig
) -> _Cells:
    pairs, groups = np.unique((nodes.astype(np.int64) << 32) | codewords, return_inverse=True)
    center = np.median(means, axis=0)
    cell_of = _cell_numbers((means - center) / config.cell_size, groups.astype(np.int64))
    # A second grid, half a cell aside, joins what a border of the first cuts: clones in one place, above all.
    firsts = np.stack([_means_of(means[:, axis], cell_of) for axis in range(3)], axis=1)
    group_of_first = np.zeros(len(firsts), np.int64)
    group_of_first[cell_of] = groups
    cell_of = _cell_numbers((firsts - center) / config.cell_size + 0.5, group_of_first)[cell_of]
    group_of_cell = np.zeros(cell_of.max() + 1, np.int64)
    group_of_cell[cell_of] = groups
    positions = np.stack([_means_of(means[:, axis], cell_of) for axis in range(3)], axis=1)
    nodes_of_cell = pairs[group_of_cell] >> 32
    return _Cells(
        of_gaussian=cell_of,
        positions=positions,
        groups=group_of_cell,
        nodes=nodes_of_cell,
        scene_spacing=_scene_spacing(positions, nodes_of_cell, config),
        extents=np.minimum(_means_of(np.median(scales, axis=1), cell_of), config.max_extent),
        support=np.bincount(cell_of, weights=opacities),
    )


def _scene_spacing(
    positions: Float64[ndarray, "m 3"], nodes: Int64[ndarray, " m"], config: ComponentConfig
) -> Float64[ndarray, " m"]:
    rank = min(config.spacing_neighbor + 1, len(positions))
    places, _ = _set_apart(positions, nodes)
    distances, _ = _nearest(places, places, rank)
    return np.minimum(config.spacing_factor * distances[:, -1], config.sparse_limit)


def _cell_numbers(places: Float[ndarray, "n 3"], groups: Int64[ndarray, " n"]) -> Int64[ndarray, " n"]:
    """A number 0 … m - 1 for each different (group, whole part of the place)."""
    # 14 bits an axis: stray Gaussians beyond 8,192 cells share the outermost ones.
    steps = np.clip(np.floor(places), -8192, 8191).astype(np.int64) + 8192
    keys = (groups << 42) | (steps[:, 0] << 28) | (steps[:, 1] << 14) | steps[:, 2]
    return np.unique(keys, return_inverse=True)[1].astype(np.int64)


def _means_of(values: Float[ndarray, " n"], cell_of: Int64[ndarray, " n"]) -> Float64[ndarray, " m"]:
    return np.bincount(cell_of, weights=values) / np.bincount(cell_of)


def _connected(cells: _Cells, config: ComponentConfig) -> Int64[ndarray, " m"]:
    """The component of each cell, by the graph of near cells of one group."""
    count = len(cells.positions)
    places, apart = _set_apart(cells.positions, cells.groups)
    neighbors = min(config.neighbors + 1, count)
    distances, targets = _nearest(places, places, neighbors)
    inside = distances < apart
    rank = min(config.spacing_neighbor, neighbors - 1)
    gaps = np.maximum(config.max_gap, cells.scene_spacing)
    spacing = np.clip(np.where(inside, distances, np.inf)[:, rank], config.cell_size, gaps)
    limits = config.spacing_factor * np.sqrt(spacing[:, None] * spacing[targets])
    limits = np.minimum(limits, np.minimum(gaps[:, None], gaps[targets]))
    extents = cells.extents[:, None] + cells.extents[targets]
    near = inside & (distances <= limits + config.extent_factor * extents)
    # Cells are in order of their groups: a chain through an actor's cells keeps them together.
    chained = np.flatnonzero((cells.groups[1:] == cells.groups[:-1]) & (cells.nodes[1:] > 0))
    sources = np.concatenate([np.broadcast_to(np.arange(count)[:, None], targets.shape)[near], chained])
    targets = np.concatenate([targets[near], chained + 1])
    graph = coo_array((np.ones(len(sources), np.uint8), (sources, targets)), shape=(count, count))
    return connected_components(graph.tocsr(), directed=False)[1].astype(np.int64)


def _absorb_by_codeword(
    owners: Int64[ndarray, " c"],
    components: Int64[ndarray, " m"],
    kept: Bool[ndarray, " c"],
    cells: _Cells,
    config: ComponentConfig,
) -> None:
    """Fragments join the component of their own group that comes nearest to any of their cells."""
    solid, loose = np.flatnonzero(kept[components]), np.flatnonzero(~kept[components])
    if not len(solid) or not len(loose):
        return
    places, apart = _set_apart(cells.positions, cells.groups)
    distances, found = (part[:, 0] for part in _nearest(places[solid], places[loose], 1))
    reach = np.maximum(config.absorb_distance, cells.scene_spacing[loose])
    hit = distances <= np.minimum(reach, apart / 2)
    fragments, targets = components[loose[hit]], components[solid[found[hit]]]
    # Writing the farthest first leaves the nearest.
    order = np.argsort(-distances[hit], kind="stable")
    owners[fragments[order]] = targets[order]


def _absorb_by_vote(
    owners: Int64[ndarray, " c"],
    components: Int64[ndarray, " m"],
    kept: Bool[ndarray, " c"],
    cells: _Cells,
    config: ComponentConfig,
) -> None:
    """Fragments still without an owner join the component that holds most of the cells around them."""
    solid, loose = np.flatnonzero(kept[components]), np.flatnonzero(owners[components] < 0)
    if not len(solid) or not len(loose):
        return
    places, apart = _set_apart(cells.positions, cells.nodes)
    neighbors = min(config.neighbors, len(solid))
    distances, found = _nearest(places[solid], places[loose], neighbors)
    reach = np.maximum(config.vote_distance, cells.scene_spacing[loose])
    hit = distances <= np.minimum(reach, apart / 2)[:, None]
    voters = np.broadcast_to(components[loose][:, None], found.shape)[hit]
    ballots, votes = np.unique(np.stack([voters, components[solid[found[hit]]]]), axis=1, return_counts=True)
    # Fewest votes first, so that the winner is written last; a tie goes to the lower component.
    order = np.lexsort((-ballots[1], votes))
    owners[ballots[0][order]] = ballots[1][order]


def _nearest(
    points: Float64[ndarray, "m 4"], queries: Float64[ndarray, "q 4"], count: int
) -> tuple[Float64[ndarray, "q k"], Int64[ndarray, "q k"]]:
    """Distances to and indices of the `count` points nearest to each query."""
    distances, indices = KDTree(points).query(queries, k=count, workers=-1)
    return np.reshape(distances, (len(queries), count)), np.reshape(indices, (len(queries), count))


def _set_apart(
    positions: Float64[ndarray, "m 3"], labels: Int64[ndarray, " m"]
) -> tuple[Float64[ndarray, "m 4"], float]:
    """Positions with a fourth axis that keeps different labels farther apart than any two of the same are."""
    apart = 2 * float(np.linalg.norm(np.ptp(positions, axis=0))) + 1
    return np.column_stack([positions, labels * apart]), apart


def _numbered_by_size(owners: Int[ndarray, " n"]) -> UInt32[ndarray, " n"]:
    """Owners (-1 = none) as 1, 2, … from most to fewest Gaussians, ties by the lower owner; none becomes 0."""
    different, inverse, counts = np.unique(owners, return_inverse=True, return_counts=True)
    real = different >= 0
    order = np.lexsort((different[real], -counts[real]))
    numbers = np.zeros(len(different), np.uint32)
    numbers[np.flatnonzero(real)[order]] = np.arange(1, real.sum() + 1)
    return numbers[inverse]
