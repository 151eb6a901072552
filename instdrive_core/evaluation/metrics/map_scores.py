"""Scores of a set of predicted maps: each view for itself, and the scene as one."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from instdrive_core.evaluation.metrics.segmentation import (
    LabelledView,
    count_confusion,
    count_id_switches,
    match_by_majority,
    match_one_to_one,
    panoptic_quality,
)


def score_views(views: Sequence[LabelledView]) -> dict[str, float | None]:
    """`miou` and `macc` of a one-to-one match inside each view, and `miou_majority`.

    Each is a mean over instances within a view, then over the views that show any; None where no view does.
    """
    pixels = [count_confusion(view.truth, view.predicted) for view in views]
    matched = [match_one_to_one(each) for each in pixels]
    return {
        "miou": _mean([each.mean_iou() for each in matched]),
        "macc": _mean([each.mean_recall() for each in matched]),
        "miou_majority": _mean([match_by_majority(each).mean_iou() for each in pixels]),
    }


def score_scene(views: Sequence[LabelledView], things: Collection[int], stuff: Collection[int]) -> dict[str, Any]:
    """One match over the pixel counts of all views: an object must keep one ID everywhere.

    `things` and `stuff` are the ground-truth IDs of either kind; both are scored under the common match.
    Every value is None where no view shows a labelled instance.
    """
    if not any(view.truth.any() for view in views):
        return dict.fromkeys(("miou", "macc", "pq", "acc25", "acc50", "id_switches", "miou_things", "miou_stuff"))
    pixels = count_confusion(
        np.concatenate([view.truth.ravel() for view in views]),
        np.concatenate([view.predicted.ravel() for view in views]),
    )
    matched = match_one_to_one(pixels)
    return {
        "miou": matched.mean_iou(),
        "macc": matched.mean_recall(),
        "pq": panoptic_quality(pixels),
        "acc25": matched.accuracy(0.25),
        "acc50": matched.accuracy(0.5),
        "id_switches": count_id_switches(views),
        "miou_things": matched.mean_iou(things),
        "miou_stuff": matched.mean_iou(stuff),
    }


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
