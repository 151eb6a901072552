"""A small picture of each object where it is seen best, with what its instance got wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.evaluation.metrics.held_out import HeldOutView
from instdrive_core.evaluation.metrics.object_rows import ObjectRow
from instdrive_core.evaluation.page.map_colors import ERROR_COLORS, NOTHING, OTHER
from instdrive_core.evaluation.page.pictures import Picture, encode_photo
from instdrive_core.scene.scene import Scene

MISSED_COLOR, EXTRA_COLOR = ERROR_COLORS[NOTHING], ERROR_COLORS[OTHER]
_HEIGHT, _MAX_WIDTH, _MAX_ENLARGED = 72, 150, 3.0
"""Pixels; small objects are enlarged at most so much."""
_MARGIN = 0.15
"""Margin on every side, as a share of the object's box."""
_DIMMED, _TINT = 0.35, 0.6


def cut_out_objects(
    scene: Scene, views: Sequence[HeldOutView], objects: Sequence[ObjectRow], budget: int
) -> dict[int, Picture]:
    """Cut each object out of the view that shows most of it, large objects first, while `budget` bytes last.

    Returns pictures by ground-truth ID.

    Bright is what object and matched instance share; blue is missed, vermilion is too much, the rest is dimmed.
    """
    best = _find_best_views(views)
    matched = {row.id: row.predicted_id for row in objects}
    found: dict[int, Picture] = {}
    in_order = sorted((row for row in objects if row.id in best), key=lambda row: -row.pixels)
    photos: dict[int, ndarray] = {}
    for row in in_order:
        number = best[row.id]
        if number not in photos:
            photos[number] = views[number].frame.load_image()
        predicted = views[number].with_ids(scene.instance_ids).predicted
        shown = np.zeros(predicted.shape, bool) if matched[row.id] is None else predicted == matched[row.id]
        picture = _cut_out(photos[number], views[number].truth == row.id, shown, views[number].truth > 0, row.name)
        budget -= picture.byte_count
        if budget < 0:
            break
        found[row.id] = picture
    return found


def _find_best_views(views: Sequence[HeldOutView]) -> Mapping[int, int]:
    """Find by ground-truth ID the position of the view with most of its pixels (ties: the first)."""
    most: dict[int, tuple[int, int]] = {}
    for number, view in enumerate(views):
        ids, counts = np.unique(view.truth[view.truth > 0], return_counts=True)
        for truth_id, count in zip(ids.tolist(), counts.tolist(), strict=True):
            if count > most.get(truth_id, (0, 0))[0]:
                most[truth_id] = count, number
    return {truth_id: number for truth_id, (_, number) in most.items()}


def _cut_out(
    photo: UInt8[ndarray, "h w 3"],
    truth: Bool[ndarray, "h w"],
    predicted: Bool[ndarray, "h w"],
    labelled: Bool[ndarray, "h w"],
    name: str,
) -> Picture:
    rows, columns = _find_box(truth)
    part = photo[rows, columns].astype(np.float32)
    meant, got, counted = truth[rows, columns], predicted[rows, columns], labelled[rows, columns]
    image = np.where((meant & got)[..., None], part, part * _DIMMED)
    for wrong, color in ((meant & ~got, MISSED_COLOR), (got & ~meant & counted, EXTRA_COLOR)):
        image[wrong] = part[wrong] * (1 - _TINT) + color * _TINT
    return encode_photo(_fit_to_row(np.round(image).astype(np.uint8)), name)


def _find_box(mask: Bool[ndarray, "h w"]) -> tuple[slice, slice]:
    slices = []
    for axis in (1, 0):
        inside = np.flatnonzero(mask.any(axis=axis))
        margin = round((inside[-1] - inside[0] + 1) * _MARGIN) + 2
        slices.append(slice(max(0, inside[0] - margin), inside[-1] + margin + 1))
    return slices[0], slices[1]


def _fit_to_row(image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "fitted_h fitted_w 3"]:
    """Resize a picture to the height of a table's row."""
    height, width = image.shape[:2]
    factor = min(_MAX_ENLARGED, _HEIGHT / height, _MAX_WIDTH / width)
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.LANCZOS))
