"""Masks of a moving thing in photos to which no corner was followed: those that its mask would cover there."""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np
from jaxtyping import Bool, Float64, Int32
from numpy import ndarray

LEAST_OVERLAP = 0.5
"""Intersection over union that a mask must have with the mask before, moved on."""


def follow_by_overlap(
    labels: dict[int, list[int]], taken: Set[tuple[int, int]], maps: Sequence[Int32[ndarray, "_ _"]]
) -> dict[int, list[int]]:
    """Follow a thing to photos before, between and after those in which it is known.

    Args:
        labels: its labels by photo; at least one photo.
        taken: photos and labels that belong to something else.
        maps: label map of each photo, 0 = nothing.
    """
    known = {photo: list(of_photo) for photo, of_photo in labels.items()}
    for step in (1, -1):
        for photo in range(len(maps)) if step > 0 else range(len(maps) - 1, -1, -1):
            if photo in known or photo - step not in known:
                continue
            expected = _move_on(known, photo - step, step, maps)
            if expected.shape != maps[photo].shape:
                continue
            label = _find_best(expected, maps[photo])
            if label and (photo, label) not in taken:
                known[photo] = [label]
    return known


def _move_on(
    known: dict[int, list[int]], photo: int, step: int, maps: Sequence[Int32[ndarray, "_ _"]]
) -> Bool[ndarray, "_ _"]:
    """Where a mask should be a photo on, if it goes on as before."""
    inside = np.isin(maps[photo], known[photo])
    if photo - step not in known:
        return inside
    rows, columns = np.round(_find_middle(inside) - _find_middle(np.isin(maps[photo - step], known[photo - step])))
    moved = np.zeros_like(inside)
    y, x = np.nonzero(inside)
    y, x = y + int(rows), x + int(columns)
    seen = (y >= 0) & (y < inside.shape[0]) & (x >= 0) & (x < inside.shape[1])
    moved[y[seen], x[seen]] = True
    return moved


def _find_middle(inside: Bool[ndarray, "_ _"]) -> Float64[ndarray, "2"]:
    return np.argwhere(inside).mean(axis=0)


def _find_best(expected: Bool[ndarray, "h w"], labels: Int32[ndarray, "h w"]) -> int:
    """The label that overlaps most; 0 where none overlaps enough."""
    if not expected.any():
        return 0
    covered = np.bincount(labels[expected])
    covered[0] = 0
    best = int(np.argmax(covered))
    union = int(expected.sum()) + int((labels == best).sum()) - int(covered[best])
    return best if best and covered[best] >= LEAST_OVERLAP * union else 0
