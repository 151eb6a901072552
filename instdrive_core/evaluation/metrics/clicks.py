"""What a user's click selects: the instance that the viewer shows at the clicked pixel, all of it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from instdrive_core.evaluation.metrics.segmentation import LabelledView, count_confusion
from instdrive_core.maths.streams import Stream, make_generator

CLICKS_PER_OBJECT = 10
"""Random pixels per visible object and view."""


@dataclass(frozen=True)
class Clicks:
    """Clicks on one object in one view that select the same instance."""

    view: int
    """Position in the list of views."""
    truth_id: int
    """The object that is meant."""
    selected: int
    """Instance under the cursor; 0 = none, nothing is selected."""
    count: int
    iou: float
    """Overlap of the selection in the instance map with the object's ground-truth mask, ignored pixels left out."""

    @property
    def hit(self) -> bool:
        """Whether the selection is the object that was meant."""
        return self.iou > 0.5


def click_things(views: Sequence[LabelledView], things: Collection[int], seed: int) -> list[Clicks]:
    """Click on `CLICKS_PER_OBJECT` seeded random pixels of each visible thing in each view."""
    clicks: list[Clicks] = []
    for number, view in enumerate(views):
        pixels = count_confusion(view.truth, view.predicted)
        columns = {int(label): column for column, label in enumerate(pixels.predicted_ids)}
        for row, truth_id in enumerate(pixels.truth_ids.tolist()):
            if truth_id not in things:
                continue
            rng = make_generator(seed, Stream.CLICKS, number, truth_id)
            shown = view.predicted[view.truth == truth_id]
            chosen = rng.choice(shown, CLICKS_PER_OBJECT, replace=len(shown) < CLICKS_PER_OBJECT)
            for selected, count in zip(*(part.tolist() for part in np.unique(chosen, return_counts=True)), strict=True):
                iou = float(pixels.iou[row, columns[selected]]) if selected else 0.0
                clicks.append(Clicks(number, truth_id, selected, count, iou))
    return clicks


def score_selections(clicks: Sequence[Clicks]) -> dict[str, float | None]:
    """`hit_rate`: share of clicks whose selection has IoU > 0.5; `iou`: its mean. None where nothing was clicked."""
    counts = np.array([each.count for each in clicks])
    if not counts.sum():
        return {"hit_rate": None, "iou": None}
    iou, hit = np.array([each.iou for each in clicks]), np.array([each.hit for each in clicks])
    return {"hit_rate": float(counts[hit].sum() / counts.sum()), "iou": float((counts * iou).sum() / counts.sum())}
