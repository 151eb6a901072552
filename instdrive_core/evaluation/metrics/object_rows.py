"""Objects of the ground truth, one row each: what became of them in the scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from instdrive_core.evaluation.metrics.segmentation import Confusion, LabelledView, count_confusion
from instdrive_core.evaluation.metrics.sharing import Holding, find_holdings
from instdrive_core.masks.ground_truth import GroundTruthInstance


@dataclass(frozen=True)
class ObjectRow:
    """One object over all held-out views."""

    id: int
    """ID in the ground truth."""
    name: str
    class_name: str
    kind: str
    """``thing`` or ``stuff``."""
    moving: bool
    pixels: int
    predicted_id: int | None
    """ID that the scene's one-to-one match gives it; None = nothing that touches it."""
    iou: float
    """Intersection over union with `predicted_id`; 0 where there is none."""
    recall: float
    instances: tuple[Holding, ...]
    """Instances that count for it, see `sharing.find_holdings`: those that hold at least 15 % of its pixels,
    the largest first."""
    codes: tuple[Holding, ...] | None
    """Codewords + 1 that count for it; None where the scene has none."""


def list_object_rows(
    shown: Sequence[LabelledView],
    coded: Sequence[LabelledView] | None,
    instances: Mapping[int, GroundTruthInstance],
) -> tuple[ObjectRow, ...]:
    """List the rows of all objects that the views show, in order of their IDs.

    Args:
        shown: every view with its instance map.
        coded: every view with the codeword + 1 of the Gaussian that each pixel stands for.
        instances: facts of the ground truth's IDs.
    """
    pixels = count_over_views(shown)
    held = find_holdings(pixels)
    codes = None if coded is None else find_holdings(count_over_views(coded))
    iou = pixels.iou
    matched = dict(zip(*linear_sum_assignment(iou, maximize=True), strict=True))
    rows = []
    for row, truth_id in enumerate(pixels.truth_ids.tolist()):
        column = matched.get(row)
        found = column is not None and pixels.shared[row, column] > 0
        fact = instances[truth_id]
        rows.append(
            ObjectRow(
                id=truth_id,
                name=fact.name,
                class_name=fact.class_name,
                kind=fact.kind,
                moving=fact.moving,
                pixels=int(pixels.truth_areas[row]),
                predicted_id=int(pixels.predicted_ids[column]) if found else None,
                iou=float(iou[row, column]) if found else 0.0,
                recall=float(pixels.shared[row, column] / pixels.truth_areas[row]) if found else 0.0,
                instances=held[truth_id],
                codes=None if codes is None else codes[truth_id],
            )
        )
    return tuple(rows)


def count_over_views(views: Sequence[LabelledView]) -> Confusion:
    """Count the pixels of all views together."""
    return count_confusion(
        np.concatenate([view.truth.ravel() for view in views]),
        np.concatenate([view.predicted.ravel() for view in views]),
    )
