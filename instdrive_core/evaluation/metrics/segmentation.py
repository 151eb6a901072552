"""Agreement of predicted instance maps with ground-truth maps.

Label maps hold integer IDs. Ground truth 0 is *ignored* (unlabelled, sky, ego vehicle, tiny instances): such pixels
count for nothing. Prediction 0 is *none*: such pixels match nothing and lower the recall of what lies there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64, Integer, UInt32
from numpy import ndarray
from scipy.optimize import linear_sum_assignment

MIN_VISIBLE_PIXELS = 100
"""Instances with fewer pixels in a view are ignored in that view."""


@dataclass(frozen=True)
class Confusion:
    """Pixel counts between t ground-truth instances and p predicted instances, both without ID 0."""

    truth_ids: Integer[ndarray, " t"]
    predicted_ids: Integer[ndarray, " p"]
    shared: Int64[ndarray, "t p"]
    """Pixels that carry both IDs."""
    truth_areas: Int64[ndarray, " t"]
    """Pixels of each ground-truth instance, unpredicted ones included."""
    predicted_areas: Int64[ndarray, " p"]
    """Pixels of each predicted instance outside the ignored regions."""
    ignored_areas: Int64[ndarray, " p"]
    """Pixels of each predicted instance inside the ignored regions."""

    @property
    def iou(self) -> Float64[ndarray, "t p"]:
        """Intersection over union of every pair, ignored pixels left out."""
        union = self.truth_areas[:, None] + self.predicted_areas[None] - self.shared
        return self.shared / np.maximum(union, 1)


@dataclass(frozen=True)
class Matching:
    """IoU and recall that a matching gives each ground-truth instance; an unmatched one has 0 and 0."""

    truth_ids: Integer[ndarray, " t"]
    iou: Float64[ndarray, " t"]
    recall: Float64[ndarray, " t"]

    def mean_iou(self, among: Iterable[int] | None = None) -> float | None:
        """Mean IoU over all instances, or over those in `among`; None where there are none."""
        kept = self.iou if among is None else self.iou[np.isin(self.truth_ids, list(among))]
        return float(kept.mean()) if len(kept) else None

    def mean_recall(self) -> float | None:
        """Mean recall (mAcc) over instances; None where there are none."""
        return float(self.recall.mean()) if len(self.recall) else None

    def accuracy(self, threshold: float) -> float | None:
        """Share of instances whose IoU exceeds `threshold`; None where there are none."""
        return float((self.iou > threshold).mean()) if len(self.iou) else None


def prepare_truth(
    labels: UInt32[ndarray, "h w"],
    ignored: Bool[ndarray, "h w"] | None = None,
    min_pixels: int = MIN_VISIBLE_PIXELS,
) -> UInt32[ndarray, "h w"]:
    """Set ignored pixels of one view's ground truth, and instances under `min_pixels` of what is left, to 0."""
    kept = labels.copy()
    if ignored is not None:
        kept[ignored] = 0
    ids, inverse, areas = np.unique(kept, return_inverse=True, return_counts=True)
    ids[areas < min_pixels] = 0
    return ids[inverse].reshape(labels.shape)


def count_confusion(truth: Integer[ndarray, "*n"], predicted: Integer[ndarray, "*n"]) -> Confusion:
    """Count shared pixels of two label arrays of one shape; several views are compared by concatenating them."""
    truth_ids, truth_index = np.unique(truth, return_inverse=True)
    predicted_ids, predicted_index = np.unique(predicted, return_inverse=True)
    shape = len(truth_ids), len(predicted_ids)
    pairs = truth_index.ravel() * shape[1] + predicted_index.ravel()
    counts = np.bincount(pairs, minlength=shape[0] * shape[1]).reshape(shape).astype(np.int64)
    labelled, named = truth_ids != 0, predicted_ids != 0
    inside = counts[labelled]
    return Confusion(
        truth_ids=truth_ids[labelled],
        predicted_ids=predicted_ids[named],
        shared=inside[:, named],
        truth_areas=inside.sum(axis=1),
        predicted_areas=inside[:, named].sum(axis=0),
        ignored_areas=counts[~labelled][:, named].sum(axis=0),
    )


def match_one_to_one(pixels: Confusion) -> Matching:
    """Match one to one so that the summed IoU is largest (Hungarian method): each predicted ID serves one ground-truth
    instance."""
    iou = pixels.iou
    rows, columns = linear_sum_assignment(iou, maximize=True)
    matched, recall = np.zeros(len(iou)), np.zeros(len(iou))
    matched[rows] = iou[rows, columns]
    recall[rows] = pixels.shared[rows, columns] / pixels.truth_areas[rows]
    return Matching(pixels.truth_ids, matched, recall)


def match_by_majority(pixels: Confusion) -> Matching:
    """Match by majority: every predicted ID joins the ground-truth instance it covers most (ties: the lower ID); unions
    are compared.

    A map in pieces wins this matching, which is why it is never the headline.
    """
    joined = np.zeros((len(pixels.truth_ids), len(pixels.predicted_ids)), bool)
    covering = np.flatnonzero(pixels.predicted_areas)
    if len(joined):
        joined[np.argmax(pixels.shared[:, covering], axis=0), covering] = True
    shared = (pixels.shared * joined).sum(axis=1)
    areas = (pixels.predicted_areas * joined).sum(axis=1)
    union = pixels.truth_areas + areas - shared
    return Matching(pixels.truth_ids, shared / np.maximum(union, 1), shared / np.maximum(pixels.truth_areas, 1))


def panoptic_quality(pixels: Confusion) -> float | None:
    """PQ (Kirillov et al. 2019), class-agnostic: Σ IoU of pairs above 0.5 / (TP + FP / 2 + FN / 2).

    A predicted instance with more than half of its pixels in ignored regions is no false positive, as in the paper.
    None where there is nothing to find.
    """
    if not len(pixels.truth_ids):
        return None
    iou = pixels.iou
    found = iou > 0.5
    excused = pixels.ignored_areas > pixels.predicted_areas
    false_positives = np.count_nonzero(~found.any(axis=0) & ~excused)
    false_negatives = np.count_nonzero(~found.any(axis=1))
    true_positives = np.count_nonzero(found)
    return float(iou[found].sum() / (true_positives + false_positives / 2 + false_negatives / 2))


@dataclass(frozen=True)
class LabelledView:
    """One view's maps, and where it stands in its camera's sequence."""

    camera: str
    time: float
    truth: Integer[ndarray, "h w"]
    predicted: Integer[ndarray, "h w"]


def count_id_switches(views: Sequence[LabelledView]) -> int:
    """Count how often ground-truth instances change their predicted ID along a camera's views.

    Its ID in a view is the predicted instance of highest IoU there (ties: the lower ID). The views of each camera
    in which the instance is labelled are taken in order of time; each change between consecutive ones counts.
    Views in which no predicted instance touches it are passed over.
    """
    last: dict[tuple[str, int], int] = {}
    switches = 0
    for view in sorted(views, key=lambda view: view.time):
        pixels = count_confusion(view.truth, view.predicted)
        if not len(pixels.predicted_ids):
            continue
        iou = pixels.iou
        best = np.argmax(iou, axis=1)
        for row in np.flatnonzero(iou.any(axis=1)):
            instance = view.camera, int(pixels.truth_ids[row])
            predicted = int(pixels.predicted_ids[best[row]])
            switches += last.get(instance, predicted) != predicted
            last[instance] = predicted
    return switches
