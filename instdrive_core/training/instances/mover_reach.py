"""What stands still belongs to a moving object only where that goes: the ghost that it left in the background.

A mask shows a car and, through its windows or past its edge, what is far behind. Where no other mask speaks of that,
votes give it to the car.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, UInt16
from numpy import ndarray
from scipy.sparse import csr_array

from instdrive_core.scene.track import Track, find_points_inside

REACH = 1.5
"""Metres around a moving object's box: of one that was seen from behind the length is a guess."""


def find_strays(
    groups: Int64[ndarray, " n"], means: Float[ndarray, "n 3"], nodes: UInt16[ndarray, " n"], tracks: Sequence[Track]
) -> Bool[ndarray, " n"]:
    """Find Gaussians of the background in the group of a moving object that is never within `REACH` of them.

    Args:
        groups: of each Gaussian; -1 = none.
        means: metres; only those of the background are looked at, which are in the world.
        nodes: 0 = background, k = the k-th track's object.
        tracks: where the moving objects are.
    """
    strays = np.zeros(len(groups), bool)
    for group, movers in _list_groups(groups, nodes).items():
        rows = np.flatnonzero((groups == group) & (nodes == 0))
        away, points = np.ones(len(rows), bool), means[rows].astype(np.float64)
        for mover in movers:
            for pose in tracks[mover - 1].world_from_box:
                away &= ~find_points_inside(points, pose, tracks[mover - 1].dimensions, REACH)
        strays[rows] = away
    return strays


def give_strays_away(
    groups: Int64[ndarray, " n"], strays: Bool[ndarray, " n"], nodes: UInt16[ndarray, " n"], shares: csr_array
) -> Int64[ndarray, " n"]:
    """Give each stray to the group of the background that got most of its votes; -1 where none got any.

    `shares` (n, g) are those of `mask_votes.compute_vote_shares`.
    """
    rows, given = np.flatnonzero(strays), groups.copy()
    standing = np.ones(int(groups.max(initial=-1)) + 1, np.float32)
    standing[list(_list_groups(groups, nodes))] = 0
    votes = csr_array(shares[rows]).multiply(standing[None]).tocsr()
    best = np.asarray(votes.argmax(axis=1)).ravel()
    most: Float64[ndarray, " r"] = np.asarray(votes.max(axis=1).todense(), np.float64).ravel()
    given[rows] = np.where(most > 0, best, -1)
    return given


def _list_groups(groups: Int64[ndarray, " n"], nodes: UInt16[ndarray, " n"]) -> dict[int, list[int]]:
    """Groups of moving objects, and the nodes in each."""
    pairs = np.unique(np.stack([groups[nodes > 0], nodes[nodes > 0].astype(np.int64)], axis=1), axis=0)
    held: dict[int, list[int]] = {}
    for group, node in pairs[pairs[:, 0] >= 0].tolist():
        held.setdefault(group, []).append(node)
    return held
