"""Instances as spatial components: Gaussians of one node and one codeword that hang together are one thing.

Nothing in training separates two objects that no photo shows together, so they may share a codeword; space tells them
apart. Gaussians are gathered into small cells, the cells of a (node, codeword) group are joined to near ones by a
k-nearest-neighbour graph whose reach follows the local spacing, and components too small to be objects are given away.
Within an actor nothing is split: its box already says that it is one thing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, UInt16, UInt32
from numpy import ndarray

from instdrive_core.instances.cells import Cells, gather_cells
from instdrive_core.instances.neighbors import NeighborForest, build_forest
from instdrive_core.instances.rejoining import RejoinConfig, rejoin_components


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
    min_support: float = 4.0
    """A component whose opacities sum to less is a fragment, not an object."""
    absorb_distance: float = 1.5
    """Metres up to which a fragment joins a component of its own codeword (more where the scene is sparse)."""
    vote_distance: float = 0.5
    """Metres up to which neighbours of other codewords vote on a fragment (more where the scene is sparse)."""
    sparse_limit: float = 10.0
    """Metres: far from the cameras Gaussians lie metres apart, and the three distances grow with the scene's local
    spacing, whatever the codewords, up to this."""
    rejoin: RejoinConfig = field(default_factory=RejoinConfig)
    """When parts that a gap divides are one object all the same."""


DEFAULT_CONFIG = ComponentConfig()


def split_components(
    means: Float[ndarray, "n 3"],
    scales: Float[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    codewords: UInt32[ndarray, " n"],
    opacities: Float[ndarray, " n"],
    config: ComponentConfig = DEFAULT_CONFIG,
) -> UInt32[ndarray, " n"]:
    """Split Gaussians into instances: ID 1 for the component of most Gaussians, then falling; 0 = none.

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
    finite = np.isfinite(means).all(axis=1) & np.isfinite(scales).all(axis=1)
    if not finite.any():
        return labels
    rows = slice(None) if finite.all() else np.flatnonzero(finite)
    cells = gather_cells(means[rows], scales[rows], nodes[rows], codewords[rows], opacities[rows], config.cell_size)
    by_node, by_group = build_forest(cells.positions, cells.nodes), build_forest(cells.positions, cells.groups)
    spacing = _measure_scene_spacing(by_node, config)
    components = _connect_cells(cells, by_group, spacing, config)
    components = rejoin_components(components, cells, by_group, config.min_support, config.rejoin)
    support = np.bincount(components, weights=cells.support)
    solid = support >= config.min_support
    owners = np.where(solid, np.arange(len(support)), -1)
    _absorb_by_codeword(owners, components, solid, cells, by_group, spacing, config)
    _absorb_by_vote(owners, components, solid, cells, by_node, spacing, config)
    labels[rows] = _number_by_size(owners[components], cells.counts)[cells.cell_of_gaussian]
    return labels


def _measure_scene_spacing(by_node: NeighborForest, config: ComponentConfig) -> Float64[ndarray, " m"]:
    """Measure `spacing_factor` times the local spacing among a node's cells of all codewords, metres."""
    count = len(by_node.rows)
    rank = min(config.spacing_neighbor + 1, count)
    distances, _ = by_node.find_nearest_to_each(rank, np.full(count, config.sparse_limit / config.spacing_factor))
    return np.minimum(config.spacing_factor * distances[:, -1], config.sparse_limit)


def _connect_cells(
    cells: Cells, by_group: NeighborForest, scene_spacing: Float64[ndarray, " m"], config: ComponentConfig
) -> Int64[ndarray, " m"]:
    """Find the component of each cell in the graph of near cells of one group; an actor's groups stay whole."""
    gaps = np.maximum(config.max_gap, scene_spacing)
    reach = gaps + config.extent_factor * (cells.extents + cells.extents.max())
    neighbors = min(config.neighbors + 1, len(gaps))
    distances, targets = by_group.find_nearest_to_each(neighbors, reach)
    rank = min(config.spacing_neighbor, neighbors - 1)
    spacing = np.clip(distances[:, rank], config.cell_size, gaps)
    parents = _join_near_pairs(
        distances, targets, spacing, gaps, cells.extents, config.spacing_factor, config.extent_factor
    )
    whole = np.where(cells.nodes > 0, cells.groups, -1)
    return _number_components(parents, whole, cells.groups)


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _join_near_pairs(distances, targets, spacing, gaps, extents, spacing_factor, extent_factor):
    """Join near pairs by union-find; returns each cell's parent, at last the lowest cell of its component."""
    parents = np.arange(len(targets))
    for cell in range(len(targets)):
        for k in range(targets.shape[1]):
            other = targets[cell, k]
            if other < 0 or other == cell:
                continue
            limit = spacing_factor * np.sqrt(spacing[cell] * spacing[other])
            limit = min(limit, gaps[cell], gaps[other]) + extent_factor * (extents[cell] + extents[other])
            if distances[cell, k] <= limit:
                _unite(parents, cell, other)
    return parents


@numba.njit(cache=True)
@no_type_check
def _unite(parents, one, other):
    one, other = _find_root(parents, one), _find_root(parents, other)
    parents[max(one, other)] = min(one, other)


@numba.njit(cache=True)
@no_type_check
def _find_root(parents, cell):
    while parents[cell] != cell:
        parents[cell] = parents[parents[cell]]
        cell = parents[cell]
    return cell


@numba.njit(cache=True)
@no_type_check
def _number_components(parents, whole, groups):
    """Number each cell's tree, in the order of the groups; cells with one number ≥ 0 in `whole` are one tree."""
    firsts = np.full(groups.max() + 1, -1, np.int64)
    for cell in range(len(parents)):
        if whole[cell] >= 0:
            if firsts[whole[cell]] < 0:
                firsts[whole[cell]] = cell
            _unite(parents, firsts[whole[cell]], cell)
    starts = np.zeros(len(firsts) + 1, np.int64)
    for cell in range(len(parents)):
        starts[groups[cell] + 1] += _find_root(parents, cell) == cell
    starts = np.cumsum(starts)
    numbers = np.empty(len(parents), np.int64)
    for cell in range(len(parents)):
        root = _find_root(parents, cell)  # never after the cell itself
        if root == cell:
            numbers[cell] = starts[groups[cell]]
            starts[groups[cell]] += 1
        else:
            numbers[cell] = numbers[root]
    return numbers


def _absorb_by_codeword(
    owners: Int64[ndarray, " c"],
    components: Int64[ndarray, " m"],
    solid: Bool[ndarray, " c"],
    cells: Cells,
    by_group: NeighborForest,
    spacing: Float64[ndarray, " m"],
    config: ComponentConfig,
) -> None:
    """Give fragments to the component of their own group that comes nearest to any of their cells."""
    loose = np.flatnonzero(~solid[components])
    reach = np.maximum(config.absorb_distance, spacing[loose])
    ranks, below = np.where(solid[components], 0, 1), np.ones(len(loose), np.int64)
    distances, found = by_group.find_nearest(cells.positions[loose], cells.groups[loose], 1, reach, ranks, below)
    hit = found[:, 0] >= 0
    fragments, targets = components[loose[hit]], components[found[hit, 0]]
    # Writing the farthest first leaves the nearest.
    order = np.argsort(-distances[hit, 0], kind="stable")
    owners[fragments[order]] = targets[order]


def _absorb_by_vote(
    owners: Int64[ndarray, " c"],
    components: Int64[ndarray, " m"],
    solid: Bool[ndarray, " c"],
    cells: Cells,
    by_node: NeighborForest,
    spacing: Float64[ndarray, " m"],
    config: ComponentConfig,
) -> None:
    """Give fragments still without an owner to the component that holds most of the cells around them."""
    loose = np.flatnonzero(owners[components] < 0)
    reach = np.maximum(config.vote_distance, spacing[loose])
    places, labels = cells.positions[loose], cells.nodes[loose]
    ranks, below = np.where(solid[components], 0, 1), np.ones(len(loose), np.int64)
    _, found = by_node.find_nearest(places, labels, config.neighbors, reach, ranks, below)
    hit = found >= 0
    voters = np.broadcast_to(components[loose][:, None], found.shape)[hit]
    ballots, votes = np.unique(voters * len(owners) + components[found[hit]], return_counts=True)
    voters, chosen = np.divmod(ballots, len(owners))
    # Fewest votes first, so that the winner is written last; a tie goes to the lower component.
    order = np.lexsort((-chosen, votes))
    owners[voters[order]] = chosen[order]


def _number_by_size(owners: Int64[ndarray, " m"], counts: Int64[ndarray, " m"]) -> UInt32[ndarray, " m"]:
    """Number owners (-1 = none, which becomes 0) of cells 1, 2, … by falling count of Gaussians, then by owner."""
    sizes = np.bincount(owners + 1, weights=counts)[1:].astype(np.int64)
    numbers = np.zeros(len(sizes) + 1, np.uint32)
    real = np.flatnonzero(sizes)
    numbers[real[np.argsort(-sizes[real], kind="stable")] + 1] = np.arange(1, len(real) + 1)
    return numbers[owners + 1]
