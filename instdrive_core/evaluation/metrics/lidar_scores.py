"""Agreement of a scene's IDs with the objects that LiDAR points of held-out sweeps lie on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.evaluation.metrics.average_precision import AP_THRESHOLDS, average_precision
from instdrive_core.evaluation.metrics.point_ids import PointIds, PointSupport, vote_point_ids
from instdrive_core.evaluation.metrics.point_truth import MIN_POINTS, LabelledSweep
from instdrive_core.evaluation.metrics.segmentation import Confusion, count_confusion, match_one_to_one
from instdrive_core.evaluation.metrics.sharing import (
    compute_mean_count,
    count_covering_ids,
    find_holdings,
    group_objects_by_id,
)

LIDAR_KEYS = (
    "ap",
    "ap50",
    "ap25",
    "miou",
    "vmeasure",
    "instances_per_object",
    "instances_to_cover",
    "objects_per_instance",
    "codes_per_object",
    "objects_per_code",
)


def score_points(
    sweeps: Sequence[LabelledSweep], supports: Sequence[PointSupport], ids: ndarray, codes: ndarray | None = None
) -> dict[str, Any]:
    """Score IDs of the scene's Gaussians over the points of all sweeps together: an object must keep its ID.

    - `ap`, `ap50`, `ap25`: class-agnostic average precision, IoU of point sets from 0.5 to 0.95, 0.5 and 0.25. An
      instance's confidence is the mean share of support that it has at its points. Unmatched instances under
      `MIN_POINTS` points are no false positives.
    - `miou`: mean IoU over objects under one one-to-one match.
    - `vmeasure`: see `v_measure`.
    - `instances_per_object` (fragmentation): mean over objects of the instances that count for it: those that hold at
      least 15 % of its points, so that a fringe is no fragment; all of them if none holds as much (`find_holdings`).
      Objects without any are left out.
    - `instances_to_cover`: stricter; mean of the fewest instances that hold 85 % of the object's points with an ID.
    - `objects_per_instance` (collisions): mean, over instances that count for any object, of how many.
    - `codes_per_object`, `objects_per_code`: the same for codewords, before spatial components part them.

    Args:
        sweeps: with ground truth.
        supports: how the scene's Gaussians support each sweep's points.
        ids: instance of each Gaussian, 0 = none.
        codes: codeword + 1 of each Gaussian; None where the scene has none.

    Every value is None where no point lies on an object.
    """
    truth = np.concatenate([np.zeros(0, np.uint32), *(sweep.truth for sweep in sweeps)])
    if not truth.any():
        return dict.fromkeys(LIDAR_KEYS)
    found = _join_parts([vote_point_ids(support, ids) for support in supports])
    counts = count_confusion(truth, found.ids)
    confidences = compute_mean_shares(found, counts.predicted_ids)
    figures: dict[str, Any] = {
        "ap": average_precision(counts, confidences, AP_THRESHOLDS, MIN_POINTS),
        "ap50": average_precision(counts, confidences, (0.5,), MIN_POINTS),
        "ap25": average_precision(counts, confidences, (0.25,), MIN_POINTS),
        "miou": match_one_to_one(counts).mean_iou(),
        "vmeasure": v_measure(counts),
        **_score_sharing(counts, "instance"),
        "instances_to_cover": _mean(count_covering_ids(counts)),
        "codes_per_object": None,
        "objects_per_code": None,
    }
    if codes is not None:
        coded = _join_parts([vote_point_ids(support, codes) for support in supports])
        figures |= _score_sharing(count_confusion(truth, coded.ids), "code")
    return figures


def compute_mean_shares(found: PointIds, ids: ndarray) -> Float64[ndarray, " p"]:
    """Mean share of support over the points of each of `ids`, which are in order."""
    place = np.searchsorted(ids, found.ids)
    place[found.ids == 0] = len(ids)
    sums = np.bincount(place, found.shares, minlength=len(ids) + 1)
    return sums[:-1] / np.maximum(np.bincount(place, minlength=len(ids) + 1)[:-1], 1)


def v_measure(counts: Confusion) -> float:
    """Harmonic mean of homogeneity and completeness (Rosenberg and Hirschberg 2007) over labelled points.

    Points without a predicted ID are one cluster.
    """
    nameless = counts.truth_areas - counts.shared.sum(axis=1)
    table = np.column_stack([counts.shared, nameless]).astype(np.float64)
    table /= table.sum()
    truth, predicted = _compute_entropy(table.sum(axis=1)), _compute_entropy(table.sum(axis=0))
    mutual = truth + predicted - _compute_entropy(table.ravel())
    homogeneity = mutual / truth if truth > 0 else 1.0
    completeness = mutual / predicted if predicted > 0 else 1.0
    both = homogeneity + completeness
    return 2 * homogeneity * completeness / both if both > 0 else 0.0


def _compute_entropy(shares: Float64[ndarray, " n"]) -> float:
    """Natural units."""
    some = shares[shares > 0]
    return float(-(some * np.log(some)).sum())


def _score_sharing(counts: Confusion, what: str) -> dict[str, float | None]:
    held = find_holdings(counts)
    return {
        f"{what}s_per_object": compute_mean_count(list(held.values())),
        f"objects_per_{what}": compute_mean_count(list(group_objects_by_id(held).values())),
    }


def _mean(values: Sequence[int]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _join_parts(parts: Sequence[PointIds]) -> PointIds:
    return PointIds(np.concatenate([part.ids for part in parts]), np.concatenate([part.shares for part in parts]))
