"""Pieces of other instances that hang in the air once what they hung in is deleted."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import find_learned
from instdrive_core.edits.queries.compact_objects import is_compact, is_tall
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import compute_current_means, find_away

REACH = 0.5
"""Metres from what is deleted within which all of a piece lies."""
LINK = 0.3
"""Metres between splats of one label that hang together."""
APART = 0.5
"""Metres from a piece to the next splat of its label, at least."""
CLEAR = 0.5
"""Metres above the foot of what is deleted: lower pieces lie on the ground."""
MOST_SHARE = 0.1
"""Splats of a piece, at most, for each of what is deleted."""
NEIGHBOR, DENSE = 4, 0.15
"""Metres from a splat of what is deleted to its fourth neighbour, in the median, at most: where splats are rare, far
from the cameras, gaps between them tell nothing."""


def find_loose_pieces(document: Document, members: Int64[ndarray, " m"]) -> Int64[ndarray, " k"]:
    """Find small pieces of other instances, rising, that hang only in what `members` are the rows of.

    Segmenters' rims give a tree's twigs to the house behind. They show beside the tree, so no photo tells that they are
    not the house's; that they hang in the air metres from it does. Pieces of cars and other single objects stay, and so
    does what is locked, moved by hand or lies on the ground.
    """
    means = compute_current_means(document.scene.gaussians, document.transforms)
    members = members[document.scene.nodes[members] == 0]
    asked = _choose_rows(document, members, means)
    if len(members) <= NEIGHBOR or not len(asked):
        return np.zeros(0, np.int64)
    tree = _build_tree(means[members])
    if np.median(tree.query(means[members[:: 1 + len(members) // 2000]], k=NEIGHBOR + 1)[0][:, -1]) > DENSE:
        return np.zeros(0, np.int64)
    distances, _ = tree.query(means[asked], distance_upper_bound=REACH)
    near, labels = asked[np.isfinite(distances)], document.scene.instance_ids
    loose = [np.zeros(0, np.int64)]
    for label in np.unique(labels[near]).tolist():
        close = near[labels[near] == label]
        rest = np.setdiff1d(asked[labels[asked] == label], close, assume_unique=True)
        if len(close) < np.count_nonzero(labels == label):
            loose.append(close[_hangs_alone(means[close], means[rest], MOST_SHARE * len(members))])
    rows = np.sort(np.concatenate(loose))
    return rows[means[rows, 2] > np.quantile(means[members, 2], 0.02) + CLEAR]


def _choose_rows(
    document: Document, members: Int64[ndarray, " m"], means: Float32[ndarray, "n 3"]
) -> Int64[ndarray, " k"]:
    """Rows around that stand still where the photos saw them, of instances that are no single objects."""
    scene, flags = document.scene, document.state.flags
    if not len(members):
        return members
    low, high = means[members].min(axis=0) - REACH - APART, means[members].max(axis=0) + REACH + APART
    free = ((means >= low) & (means <= high)).all(axis=1) & (scene.nodes == 0) & find_learned(scene)
    free &= (flags & (Flag.DELETED | Flag.LOCKED)) == 0
    free[members] = False
    rows = np.flatnonzero(free)
    single = [instance.id for instance in scene.table if is_compact(instance) and not is_tall(instance)]
    return rows[~np.isin(scene.instance_ids[rows], single) & ~find_away(document.transforms, rows)]


def _hangs_alone(close: ndarray, rest: ndarray, most: float) -> ndarray:
    """Which of the points belong to pieces of at most so many that are far from the rest."""
    alone = _is_far(close, rest, APART)
    inner = close[alone]
    if not len(inner):
        return alone
    tree = _build_tree(inner)
    _, pieces = connected_components(tree.sparse_distance_matrix(tree, LINK), directed=False)
    held = np.bincount(pieces, ~_is_far(inner, close[~alone], LINK)) > 0  # what hangs on something that is not alone
    alone[alone] = (~held & (np.bincount(pieces) <= most))[pieces]
    return alone


def _is_far(points: ndarray, others: ndarray, distance: float) -> ndarray:
    if not len(others):
        return np.ones(len(points), bool)
    return np.isinf(_build_tree(others).query(points, distance_upper_bound=distance)[0])


def _build_tree(points: ndarray) -> KDTree:
    """A tree that is built quickly: few are asked."""
    return KDTree(points, balanced_tree=False, compact_nodes=False)
