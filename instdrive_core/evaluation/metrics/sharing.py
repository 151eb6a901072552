"""Fragmentation and collisions by object: predicted IDs that one object is in, and objects that share an ID.

Pixels or points of an object that carry a neighbour's ID along its border are a fringe, no fragment: an ID counts for
an object only if it holds a share of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from instdrive_core.evaluation.metrics.segmentation import Confusion

MIN_SHARE = 0.15
"""An ID that holds a smaller share of an object than this does not count for it. The smallest with which true IDs, on
trained geometry, count once for every object: at 0.10 fringes make 1.045 of it, at 0.05 1.13."""


@dataclass(frozen=True)
class Holding:
    """One predicted ID that counts for an object."""

    predicted_id: int
    share: float
    """Share of the object's pixels (or points)."""


def find_holdings(counts: Confusion, min_share: float = MIN_SHARE) -> dict[int, tuple[Holding, ...]]:
    """Find by ground-truth ID the predicted IDs that hold at least `min_share` of it, the largest first (ties: the
    lower ID). Of a shattered object, which has IDs but none that holds so much, all count.

    Pixels without a predicted ID belong to the whole but to none of the parts: shares may sum to less than 1, and an
    object with less than `min_share` under any ID has none.
    """
    found = {}
    shares = counts.shared / np.maximum(counts.truth_areas, 1)[:, None]
    for truth_id, share in zip(counts.truth_ids.tolist(), shares, strict=True):
        order = np.argsort(-share, kind="stable")
        order = order[share[order] > 0] if share.sum() >= min_share else order[:0]
        kept = order[share[order] >= min_share] if share.max(initial=0) >= min_share else order
        found[truth_id] = tuple(Holding(int(counts.predicted_ids[column]), float(share[column])) for column in kept)
    return found


def group_objects_by_id(held: dict[int, tuple[Holding, ...]]) -> dict[int, tuple[int, ...]]:
    """Group by predicted ID the ground-truth IDs that it counts for, in order."""
    objects: dict[int, list[int]] = {}
    for truth_id in sorted(held):
        for holding in held[truth_id]:
            objects.setdefault(holding.predicted_id, []).append(truth_id)
    return {predicted_id: tuple(objects[predicted_id]) for predicted_id in sorted(objects)}


def find_shared_ids(held: dict[int, tuple[Holding, ...]]) -> dict[int, tuple[int, ...]]:
    """Find the collisions: predicted IDs that count for more than one object, with these objects."""
    return {key: objects for key, objects in group_objects_by_id(held).items() if len(objects) > 1}


def count_covering_ids(counts: Confusion, covered: float = 1 - MIN_SHARE) -> list[int]:
    """Count for each object that has IDs the fewest of them that hold `covered` of all that has one. Crumbs, each too
    small to count for the object, are found by this."""
    shared = np.sort(counts.shared, axis=1)[:, ::-1]
    shared = shared[shared.any(axis=1)]
    reached = np.cumsum(shared, axis=1) >= covered * shared.sum(axis=1, keepdims=True)
    return (np.argmax(reached, axis=1) + 1).tolist()


def compute_mean_count(groups: Sequence[Sequence[object]]) -> float | None:
    """Compute the mean size of the groups that are not empty; None where all are."""
    sizes = [len(group) for group in groups if len(group)]
    return float(np.mean(sizes)) if sizes else None
