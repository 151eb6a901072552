"""Which Gaussians make up each mask: those that contribute most to its pixels and to few others."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Int, Int32, Int64
from numpy import ndarray
from scipy.sparse import csr_array

from instdrive_core.rasterize.blend_weights import BlendWeights
from instdrive_core.training.feature_weights import weights_of_view
from instdrive_core.training.model import SceneModel
from instdrive_core.training.view_store import ViewStore

PIXELS_PER_VIEW = 150_000
"""Photos of more pixels are looked at on a grid of about so many: sparser ones miss Gaussians that they do show."""


@dataclass(frozen=True)
class MaskMembers:
    """Gaussians, masks and photos; everything that is not stored is "no"."""

    members: csr_array
    """(n, m) float32 of ones: the Gaussian belongs to the mask. At most one mask of each photo."""
    seen: csr_array
    """(n, v) float32 of ones: the Gaussian is the top contributor of some masked pixel of the photo."""
    view_of_mask: Int32[ndarray, " m"]
    """Rising; photos without masks are not counted."""

    def __len__(self) -> int:
        return len(self.members.indptr) - 1

    @staticmethod
    def of(
        rows: Int[ndarray, " p"],
        masks: Int[ndarray, " p"],
        count: int,
        view_of_mask: Int[ndarray, " m"],
        share: float = 0.5,
    ) -> MaskMembers:
        """From the top contributor and the mask of each pixel of all photos.

        Args:
            rows: Gaussians.
            masks: counted through all photos.
            count: n.
            view_of_mask: of each mask, rising from 0.
            share: a Gaussian belongs to a mask that holds more than this of its pixels in the photo, at least 0.5.
        """
        masks_in_all, views_in_all = len(view_of_mask), int(view_of_mask.max(initial=-1)) + 1
        pairs, pixels = np.unique(rows.astype(np.int64) * masks_in_all + masks, return_counts=True)
        rows, masks = pairs // max(masks_in_all, 1), pairs % max(masks_in_all, 1)
        in_view = rows * views_in_all + view_of_mask[masks]
        views, places = np.unique(in_view, return_inverse=True)
        belongs = pixels > share * np.bincount(places, weights=pixels, minlength=len(views))[places]
        members = _ones(rows[belongs], masks[belongs], (count, masks_in_all))
        seen = _ones(views // max(views_in_all, 1), views % max(views_in_all, 1), (count, views_in_all))
        return MaskMembers(members, seen, view_of_mask.astype(np.int32))


def mask_members(model: SceneModel, store: ViewStore, min_alpha: float, share: float) -> MaskMembers:
    """Look at every view that has masks; pixels outside all masks or with less than `min_alpha` opacity say nothing.

    The model is on the CPU; `share` as in `MaskMembers.of`. The same input gives the same bits, whatever the number
    of threads.
    """
    rows: list[ndarray] = []
    masks: list[ndarray] = []
    view_of_mask: list[int] = []
    looked_at = 0
    for number in range(len(store)):
        store.prefetch([(ahead, False) for ahead in range(number + 1, min(number + 3, len(store)))])
        view = store.get(number)
        if view.labels is None or not view.labels.any():
            continue
        pixels = _grid_pixels(view.labels)
        of_view, weights = weights_of_view(model, view, pixels)
        top = top_contributors(weights, min_alpha)
        shown = top >= 0
        labels, mask_of_pixel = np.unique(view.labels.ravel()[pixels[shown]], return_inverse=True)
        rows.append(of_view[top[shown]].astype(np.int32))
        masks.append((mask_of_pixel + len(view_of_mask)).astype(np.int32))
        view_of_mask += [looked_at] * len(labels)
        looked_at += len(labels) > 0
    store.release()
    nothing = [np.zeros(0, np.int32)]
    of_masks = np.array(view_of_mask, np.int32)
    return MaskMembers.of(np.concatenate(rows + nothing), np.concatenate(masks + nothing), len(model), of_masks, share)


def top_contributors(weights: BlendWeights, min_alpha: float) -> Int64[ndarray, " p"]:
    """The Gaussian with the largest weight in each pixel (ties: the nearer one); -1 where all together hide less than
    `min_alpha`."""
    top = np.empty(len(weights.indptr) - 1, np.int64)
    _top(weights.indptr, weights.rows, weights.weights, np.float32(min_alpha), top)
    return top


def _grid_pixels(labels: Int[ndarray, "h w"]) -> Int64[ndarray, " p"]:
    """Flat indices of the masked pixels on the grid, rising."""
    step = max(1, round(sqrt(labels.size / PIXELS_PER_VIEW)))
    shown = np.zeros(labels.shape, bool)
    shown[::step, ::step] = labels[::step, ::step] > 0
    return np.flatnonzero(shown)


def _ones(rows: Int64[ndarray, " k"], columns: Int64[ndarray, " k"], shape: tuple[int, int]) -> csr_array:
    """Of pairs sorted by row, then column."""
    indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=shape[0]))])
    return csr_array((np.ones(len(rows), np.float32), columns, indptr), shape=shape)


@numba.njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def _top(starts, rows, weights, min_alpha, top):
    for pixel in numba.prange(len(starts) - 1):
        alpha, best, found = np.float32(0), np.float32(0), -1
        for entry in range(starts[pixel], starts[pixel + 1]):
            alpha += weights[entry]
            if weights[entry] > best:
                best, found = weights[entry], rows[entry]
        top[pixel] = found if alpha >= min_alpha else -1
