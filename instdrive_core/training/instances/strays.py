"""What votes give to a thing though it stands far away from it.

A mask shows a car and, through its windows or past its edge, what is far behind. Where no other mask speaks of that,
votes give it to the car. A thing that moves takes along only what stands where it goes (the ghost that it left in the
background), and one that stands only what stands near it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, UInt16
from numpy import ndarray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from instdrive_core.instances.interiors import DEFAULT_CONFIG, TALLEST_VEHICLE, CompactObject, fit_compact_object
from instdrive_core.maths.groups import split_by_group
from instdrive_core.scene.track import Track, find_points_inside

REACH = 1.5
"""Metres around a thing: of a moving one that was seen from behind the length is a guess. Around what is smaller, such
as a person, it is the longer of the two sides on the ground: of those, the size is known."""
GAP, CELL = 1.0, 0.25
"""Metres between cells of a thing, and their size, from which on it is divided into parts."""
SCRAP = 0.1
"""A part with less than this share of the main part's Gaussians may be a stray."""
MAIN = 0.75
"""Share of a standing thing's Gaussians that its main part has at least: else it is seen in pieces, or is several."""


@dataclass(frozen=True)
class Reach:
    """Where a thing is, as far as it is known."""

    movers: tuple[Track, ...] = ()
    """The moving objects that it is; a standing thing is none."""
    body: CompactObject | None = None
    """What a standing thing's main part fills."""

    def holds(self, points: Float64[ndarray, "k 3"]) -> Bool[ndarray, " k"]:
        """Whether points (metres, in the world) are within `REACH` of the thing, wherever it goes."""
        held = np.zeros(len(points), bool)
        for mover in self.movers:
            reach = min(REACH, float(mover.dimensions[:2].max()))
            for pose in mover.world_from_box:
                held |= find_points_inside(points, pose, mover.dimensions, reach)
        if self.body is not None:
            held |= self.body.holds((points - self.body.center) @ self.body.axes, margin=REACH)
        return held


def find_reaches(
    groups: Int64[ndarray, " n"],
    means: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    tracks: Sequence[Track],
) -> dict[int, Reach]:
    """Find the groups of which it is known where they are: what moves, and compact things no higher than vehicles.

    What is taller, a house or a tree, may well go on behind what hides it.

    Args:
        groups: of each Gaussian; -1 = none.
        means: metres; those of the background are in the world.
        opacities: in [0, 1].
        nodes: 0 = background, k = the k-th track's object.
        tracks: where the moving objects are.
    """
    reaches = {
        group: Reach(tuple(tracks[node - 1] for node in held)) for group, held in _list_movers(groups, nodes).items()
    }
    rows = np.flatnonzero((nodes == 0) & (groups >= 0) & (opacities >= DEFAULT_CONFIG.min_opacity))
    for group, members in split_by_group(groups, rows):
        if group not in reaches:
            points = means[members].astype(np.float64)
            main = points[_is_in_main_part(points)]
            is_one = len(main) >= max(DEFAULT_CONFIG.min_gaussians, MAIN * len(points))
            body = fit_compact_object(group, main) if is_one else None
            if body is not None and float(np.ptp(np.quantile(main[:, 2], [0.01, 0.99]))) <= TALLEST_VEHICLE:
                reaches[group] = Reach(body=body)
    return reaches


def find_strays(
    groups: Int64[ndarray, " n"], means: Float[ndarray, "n 3"], nodes: UInt16[ndarray, " n"], reaches: dict[int, Reach]
) -> Bool[ndarray, " n"]:
    """Find Gaussians of the background that are far from the thing whose group they are in.

    Of a standing thing they also hang together with no more than a scrap of it: a hedge that goes on behind a car is
    one thing.
    """
    strays = np.zeros(len(groups), bool)
    for group, rows in split_by_group(groups, np.flatnonzero((nodes == 0) & np.isin(groups, list(reaches)))):
        points, reach = means[rows].astype(np.float64), reaches[group]
        strays[rows] = ~reach.holds(points)
        if not reach.movers:
            strays[rows] &= _is_in_scrap(points)
    return strays


def give_strays_away(
    groups: Int64[ndarray, " n"],
    strays: Bool[ndarray, " n"],
    means: Float[ndarray, "n 3"],
    shares: csr_array,
    reaches: dict[int, Reach],
) -> Int64[ndarray, " n"]:
    """Give each stray to the group that got most of its votes and may be where it is; -1 where none got any.

    `shares` (n, g) are those of `mask_votes.compute_vote_shares`. What moves gets no strays.
    """
    rows, given = np.flatnonzero(strays), groups.copy()
    votes = csr_array(shares[rows]).tocoo()
    may = votes.col != groups[rows][votes.row]
    for group in np.unique(votes.col).tolist():
        if group in reaches:
            mine = votes.col == group
            near = reaches[group].holds(means[rows[votes.row[mine]]].astype(np.float64))
            may[mine] &= near & (not reaches[group].movers)
    votes = csr_array((votes.data * may, (votes.row, votes.col)), votes.shape)
    best = np.asarray(votes.argmax(axis=1)).ravel()
    most: Float64[ndarray, " r"] = np.asarray(votes.max(axis=1).todense(), np.float64).ravel()
    given[rows] = np.where(most > 0, best, -1)
    return given


def _is_in_main_part(points: Float64[ndarray, "k 3"]) -> Bool[ndarray, " k"]:
    parts = _divide(points)
    return parts == np.bincount(parts).argmax()


def _is_in_scrap(points: Float64[ndarray, "k 3"]) -> Bool[ndarray, " k"]:
    parts = _divide(points)
    sizes = np.bincount(parts)
    return sizes[parts] < SCRAP * sizes.max()


def _divide(points: Float64[ndarray, "k 3"]) -> Int64[ndarray, " k"]:
    """The number of each point's part; gaps of more than `GAP` divide parts."""
    cells, cell_of_point = np.unique(np.floor(points / CELL), axis=0, return_inverse=True)
    pairs = KDTree(cells * CELL).query_pairs(GAP, output_type="ndarray")
    links = csr_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), (len(cells), len(cells)))
    return connected_components(links, directed=False)[1][cell_of_point.ravel()].astype(np.int64)


def _list_movers(groups: Int64[ndarray, " n"], nodes: UInt16[ndarray, " n"]) -> dict[int, list[int]]:
    """Groups of moving objects, and the nodes in each."""
    pairs = np.unique(np.stack([groups[nodes > 0], nodes[nodes > 0].astype(np.int64)], axis=1), axis=0)
    held: dict[int, list[int]] = {}
    for group, node in pairs[pairs[:, 0] >= 0].tolist():
        held.setdefault(group, []).append(node)
    return held
