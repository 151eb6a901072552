"""Colours that make maps comparable by eye: matched instances share one, and an error map says what went wrong."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Integer, UInt8
from numpy import ndarray
from scipy.optimize import linear_sum_assignment

from instdrive_core.evaluation.metrics.segmentation import Confusion
from instdrive_core.instances.colormap import ID_LIMIT, colors_from_ids

IGNORED, RIGHT, OTHER, PIECE, NOTHING = range(5)
ERROR_NAMES = {
    RIGHT: "right: the ID matched to this object",
    OTHER: "wrong instance: the ID matched to another object",
    PIECE: "wrong instance: an ID matched to no object (a further piece)",
    NOTHING: "no instance",
    IGNORED: "ignored: unlabelled, sky, ego vehicle, tiny",
}
ERROR_COLORS = np.array([[38, 41, 46], [203, 208, 214], [213, 94, 0], [240, 200, 50], [0, 114, 178]], np.uint8)
"""Colours by category; the three errors are told apart by every kind of colour vision (Okabe and Ito 2008)."""
_BOUNDARY = np.array([110, 116, 124], np.uint8)
_STRIPE, _STRIPE_PERIOD = np.array([45, 47, 51], np.uint8), 7


def match_ids(pixels: Confusion) -> dict[int, int]:
    """Match IDs one to one by the largest summed IoU: ground-truth ID by predicted ID.

    As in `match_one_to_one`; pairs that share no pixel are left out.
    """
    rows, columns = linear_sum_assignment(pixels.iou, maximize=True)
    touching = pixels.shared[rows, columns] > 0
    predicted, truth = pixels.predicted_ids[columns[touching]], pixels.truth_ids[rows[touching]]
    return dict(zip(predicted.tolist(), truth.tolist(), strict=True))


def color_matched(ids: Integer[ndarray, "h w"], truth_of: Mapping[int, int]) -> UInt8[ndarray, "h w 3"]:
    """Colour each ID as the ground-truth ID that it stands for; others are grey under stripes, 0 is black.

    For the ground truth itself `truth_of` maps each matched ID to itself.
    """
    values, index = np.unique(ids, return_inverse=True)
    index = index.reshape(ids.shape)
    colors = _choose_greys(values)
    matched = np.array([value in truth_of for value in values.tolist()], bool)
    named = [truth_of[value] for value in values[matched].tolist()]
    colors[matched] = colors_from_ids(np.array(named, np.uint32))
    image = colors[index]
    image[_draw_stripes(*ids.shape) & (~matched & (values != 0))[index]] = _STRIPE
    return image


def color_bijectively(ids: Integer[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    """Colour every ID as the editor and ID pictures do (codewords beyond 24 bits: modulo 2^24)."""
    return colors_from_ids((ids.astype(np.uint64) % np.uint64(ID_LIMIT)).astype(np.uint32))


def classify_pixels(
    truth: Integer[ndarray, "h w"], predicted: Integer[ndarray, "h w"], truth_of: Mapping[int, int]
) -> Integer[ndarray, "h w"]:
    """Say what became of each pixel: one of IGNORED, RIGHT, OTHER, PIECE, NOTHING."""
    values, index = np.unique(predicted, return_inverse=True)
    meant = np.array([truth_of.get(value, 0) for value in values.tolist()], np.int64)[index].reshape(truth.shape)
    category = np.where(meant == truth, RIGHT, np.where(meant > 0, OTHER, PIECE))
    category = np.where(predicted == 0, NOTHING, category)
    return np.where(truth == 0, IGNORED, category)


def color_errors(categories: Integer[ndarray, "h w"], truth: Integer[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    """Colour an error map and draw the outlines of the ground truth's instances into it."""
    image = ERROR_COLORS[categories]
    edges = np.zeros(truth.shape, bool)
    edges[:, 1:] |= truth[:, 1:] != truth[:, :-1]
    edges[1:] |= truth[1:] != truth[:-1]
    image[edges & (categories == RIGHT)] = _BOUNDARY
    return image


def _choose_greys(values: Integer[ndarray, " k"]) -> UInt8[ndarray, "k 3"]:
    """A grey per ID, neighbouring IDs far apart; black for 0."""
    grey = 105 + values.astype(np.uint64) * np.uint64(61) % np.uint64(110)
    grey[values == 0] = 0
    return np.repeat(grey[:, None], 3, axis=1).astype(np.uint8)


def _draw_stripes(height: int, width: int) -> ndarray:
    return np.add.outer(np.arange(height), np.arange(width)) % _STRIPE_PERIOD == 0
