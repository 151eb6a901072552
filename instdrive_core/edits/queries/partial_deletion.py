"""Instances deleted in part: what the user kept on purpose, and scraps that were missed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from instdrive_core.edits.document.document import Document
from instdrive_core.scene.selection import Flag

_LINKS = 6
"""Nearest splats of an instance that each of its splats hangs together with, where both are left."""
_WITNESSES = 16
"""Nearest splats that tell whether what is around a scrap was deleted."""
_GONE_SHARE = 2 / 3
"""Share of them that is deleted around a scrap that was missed."""
_SCRAP_SHARE, _SCRAP_COUNT = 0.02, 5
"""A scrap has at most this share of the deleted splats, or so many: larger pieces were left on purpose."""


@dataclass(frozen=True)
class Remainder:
    """The rows of one instance, rising, after some of them were deleted."""

    gone: Int64[ndarray, " g"]
    """Deleted, now or before."""
    kept: Int64[ndarray, " k"]
    """Left on purpose."""
    missed: Int64[ndarray, " m"]
    """Left in small scraps amid what is gone."""


def divide_instance(document: Document, instance_id: int, deleted: Int64[ndarray, " d"]) -> Remainder:
    """Divide an instance of which these rows are deleted, or are about to be. Raises EditError for an unknown ID."""
    members = document.find_rows((instance_id,))
    left = (document.state.flags[members] & Flag.DELETED) == 0
    left &= ~np.isin(members, deleted)
    missed = np.zeros(len(members), bool)
    if left.any() and not left.all():
        missed[left] = _find_missed(document.compute_means(members).astype(np.float64), left)
    return Remainder(members[~left], members[left & ~missed], members[missed])


def is_near_deleted(document: Document, rows: Int64[ndarray, " n"], remainder: Remainder) -> Bool[ndarray, " n"]:
    """Mask of the rows that stand where most of the instance was deleted, not where it was kept."""
    if not len(remainder.kept) or not len(rows):
        return np.ones(len(rows), bool)
    known = np.concatenate([remainder.gone, remainder.kept])
    found = _find_nearest(
        document.compute_means(known).astype(np.float64), document.compute_means(rows).astype(np.float64), _LINKS
    )
    return (found < len(remainder.gone)).mean(axis=1) > 0.5


def _find_missed(means: Float64[ndarray, "n 3"], left: Bool[ndarray, " n"]) -> Bool[ndarray, " k"]:
    """Mask of the splats left over that belong to missed scraps."""
    rows = np.flatnonzero(left)
    found = _find_nearest(means, means[rows], _WITNESSES + 1)[:, 1:]
    place = np.full(len(left), -1)
    place[rows] = np.arange(len(rows))
    one, other = np.repeat(np.arange(len(rows)), min(_LINKS, found.shape[1])), place[found[:, :_LINKS]].ravel()
    links = coo_array((np.ones((other >= 0).sum()), (one[other >= 0], other[other >= 0])), (len(rows), len(rows)))
    count, scrap = connected_components(links, directed=False)
    around = np.where(left[found], scrap[place[found]], -1)
    gone = np.bincount(scrap, weights=(around < 0).sum(axis=1), minlength=count)
    outside = np.bincount(scrap, weights=(around != scrap[:, None]).sum(axis=1), minlength=count)
    small = np.bincount(scrap, minlength=count) <= max(_SCRAP_SHARE * np.count_nonzero(~left), _SCRAP_COUNT)
    return (small & (gone >= _GONE_SHARE * outside) & (gone > 0))[scrap]


def _find_nearest(points: Float64[ndarray, "n 3"], asked: Float64[ndarray, "m 3"], count: int) -> Int64[ndarray, "m k"]:
    """The `count` nearest points, nearest first; all of them where there are fewer."""
    _, found = KDTree(points).query(asked, k=min(count, len(points)))
    return np.asarray(found, np.int64).reshape(len(asked), -1)
