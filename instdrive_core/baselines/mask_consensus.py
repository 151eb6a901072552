"""Consensus of masks: masks of different photos show one thing where many photos put them into one mask."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from jaxtyping import Bool, Float32, Int64, Integer
from numpy import ndarray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import squareform

from instdrive_core.baselines.mask_members import MaskMembers

_ROUNDING = 1e-6
"""Shares and means that fall short of a threshold by less have reached it."""
_BLOCK = 1024
"""Masks that are compared with all others at a time."""


@dataclass(frozen=True)
class MaskGraphConfig:
    """The rules of the graph. A photo "sees" a Gaussian that is the top contributor of one of its masked pixels."""

    member_share: float = 0.5
    """A Gaussian belongs to the mask that holds more than this of the pixels it contributes most to, in one photo."""
    observed_share: float = 0.3
    """A photo observes a mask if it sees at least this much of the mask's Gaussians."""
    contained_share: float = 0.6
    """A mask is contained in another photo's mask if that holds at least this much of its Gaussians seen there."""
    uncontained_share: float = 0.8
    """A mask that is contained in nothing in more than this much of the photos that observe it is dropped."""
    linkage_stop: float = 0.5
    """Mean of support / (observers + 1) down to which groups of masks are merged."""


@dataclass(frozen=True)
class MaskRelations:
    """Relation of each photo to each mask of any photo, its own included."""

    contained: csr_array
    """(m, m) float32 of ones: the mask of the row is contained in that of the column, at most one of each photo."""
    observed: Bool[ndarray, "m v"]
    view_of_mask: Integer[ndarray, " m"]

    def exclude(self, dropped: Bool[ndarray, " m"]) -> MaskRelations:
        """Copy without some masks: photos that put others into one of these say nothing about them."""
        inside = cast(csr_array, self.contained[:, np.flatnonzero(dropped)]).tocoo()
        observed = self.observed.copy()
        observed[inside.coords[0], self.view_of_mask[dropped][inside.coords[1]]] = False
        kept = np.flatnonzero(~dropped)
        return MaskRelations(self.contained[kept][:, kept], observed[kept], self.view_of_mask[kept])

    def consensus(self, rows: Integer[ndarray, " r"], columns: Integer[ndarray, " c"]) -> Float32[ndarray, "r c"]:
        """support / (observers + 1) of pairs of masks: in how many photos both are contained in one mask, and how many
        observe both."""
        support = (self.contained[rows] @ self.contained[columns].T).toarray()
        observers = self.observed[rows].astype(np.float32) @ self.observed[columns].T.astype(np.float32)
        return (support / (observers + 1)).astype(np.float32)


def relate_masks(of: MaskMembers, config: MaskGraphConfig) -> MaskRelations:
    """Find which photos observe which masks, and which masks contain them there."""
    masks_by_gaussian = of.members.T.tocsr()
    sizes = np.asarray(of.members.sum(axis=0)).ravel()
    seen = (masks_by_gaussian @ of.seen).toarray()
    observed = (seen >= config.observed_share * sizes[:, None] - _ROUNDING) & (seen > 0)
    shared = cast(csr_array, masks_by_gaussian @ of.members).tocoo()
    mask, other = shared.coords
    view = of.view_of_mask[other]
    contained = observed[mask, view] & (shared.data >= config.contained_share * seen[mask, view] - _ROUNDING)
    mask, other = mask[contained], other[contained]
    ones = np.ones(len(mask), np.float32)
    return MaskRelations(csr_array((ones, (mask, other)), shape=shared.shape), observed, of.view_of_mask)


def find_dropped_masks(relations: MaskRelations, config: MaskGraphConfig) -> Bool[ndarray, " m"]:
    """Find masks that photos other than their own hardly confirm, and masks that no Gaussian belongs to."""
    observers = relations.observed.sum(axis=1)
    uncontained = observers - np.asarray(relations.contained.sum(axis=1)).ravel()
    return (observers == 0) | (uncontained > config.uncontained_share * observers + _ROUNDING)


def link_masks(relations: MaskRelations, config: MaskGraphConfig) -> Int64[ndarray, " m"]:
    """Group masks by average linkage: the group 0 … k - 1 of each, in the order of their first masks.

    Two groups that are merged hold a pair that reaches the limit by itself, so nothing is ever merged across the
    components of the graph of such pairs: each is linked alone, with all of its pairs.
    """
    components = _find_components(relations, config.linkage_stop)
    groups, found = np.empty(len(components), np.int64), 0
    order = np.argsort(components, kind="stable")
    for masks in np.split(order, np.cumsum(np.bincount(components))[:-1]):
        local = link_by_average(relations.consensus(masks, masks), config.linkage_stop)
        groups[masks] = found + local
        found += int(local.max(initial=-1)) + 1
    _, first, places = np.unique(groups, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first, kind="stable"), kind="stable")[places].astype(np.int64)


def link_by_average(similarities: Float32[ndarray, "k k"], stop: float) -> Int64[ndarray, " k"]:
    """Merge groups of things as long as the mean similarity of two groups is at least `stop`; returns groups 0 …"""
    if len(similarities) == 1:
        return np.zeros(1, np.int64)
    distances = 1 - similarities.astype(np.float64)
    np.fill_diagonal(distances, 0)
    tree = linkage(squareform(distances, checks=False), "average")
    return fcluster(tree, 1 - stop + _ROUNDING, "distance").astype(np.int64) - 1


def _find_components(relations: MaskRelations, stop: float) -> Int64[ndarray, " m"]:
    """Find the components of the graph of the pairs whose consensus reaches `stop`."""
    count = len(relations.view_of_mask)
    everything = np.arange(count)
    sources, targets = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for start in range(0, count, _BLOCK):
        rows, columns = np.nonzero(
            relations.consensus(everything[start : start + _BLOCK], everything) >= stop - _ROUNDING
        )
        sources.append(rows + start)
        targets.append(columns)
    pairs = (np.concatenate(sources), np.concatenate(targets))
    graph = coo_array((np.ones(len(pairs[0]), np.uint8), pairs), shape=(count, count))
    return cast(ndarray, connected_components(graph.tocsr(), directed=False)[1]).astype(np.int64)
