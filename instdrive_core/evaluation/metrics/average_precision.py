"""Average precision of predicted instances, class-agnostic, as COCO counts it (Lin et al. 2014)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_core.evaluation.metrics.segmentation import Confusion

AP_THRESHOLDS = tuple(np.arange(50, 100, 5) / 100)
"""0.50, 0.55 … 0.95: AP is the mean over them."""


def average_precision(
    counts: Confusion, confidences: Float64[ndarray, " p"], thresholds: Sequence[float], min_size: int = 0
) -> float | None:
    """Mean over IoU `thresholds` of the area under the precision–recall curve; None where there is nothing to find.

    Predictions are taken by falling confidence (ties: the lower ID); each finds the object of highest IoU that is
    still free, if that reaches the threshold. One that finds none is a false positive, unless it is smaller than
    `min_size` pixels (or points) or at least the threshold's share of it lies in ignored regions. Precision is made
    monotone and the area taken at every step of recall rather than at COCO's 101.
    """
    if not len(counts.truth_ids):
        return None
    order = np.lexsort((counts.predicted_ids, -confidences))
    iou = counts.iou[:, order]
    size = (counts.predicted_areas + counts.ignored_areas)[order]
    ignored = counts.ignored_areas[order] / np.maximum(size, 1)
    areas = []
    for threshold in thresholds:
        hits = _find_hits(iou, threshold)
        counted = hits | ((size >= min_size) & (ignored < threshold))
        areas.append(_compute_area(hits[counted], len(counts.truth_ids)))
    return float(np.mean(areas))


def _find_hits(iou: Float64[ndarray, "t p"], threshold: float) -> Bool[ndarray, " p"]:
    """Find out which predictions, in order, find an object."""
    hits = np.zeros(iou.shape[1], bool)
    free = np.ones(len(iou), bool)
    for column in np.flatnonzero((iou >= threshold).any(axis=0)):
        best = int(np.argmax(np.where(free, iou[:, column], -1)))
        if free[best] and iou[best, column] >= threshold:
            hits[column], free[best] = True, False
    return hits


def _compute_area(hits: Bool[ndarray, " p"], objects: int) -> float:
    """Area under the precision–recall curve of predictions in order."""
    found = np.cumsum(hits)
    precision = found / np.arange(1, len(hits) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(envelope[hits].sum() / objects)
