"""Members of each mask: the Gaussians that contribute most to its pixels and to few others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import sqrt

import numpy as np
from jaxtyping import Int32, Int64, Integer
from numpy import ndarray
from scipy.sparse import csr_array

from instdrive_core.rasterize.kernels.top_contributors import find_top_contributors
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.feature_weights import place_gaussians_in_view
from instdrive_core.training.views.view_store import ViewStore

PIXELS_PER_VIEW = 150_000
"""Photos of more pixels are looked at on a grid of about so many: sparser ones miss Gaussians that they do show."""

_NO_PAIRS = np.zeros((2, 0), np.int64)


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
    def from_pixels(
        photos: Iterable[tuple[Integer[ndarray, " _"], Integer[ndarray, " _"]]], count: int, share: float
    ) -> MaskMembers:
        """Count members from the top contributor and the mask of each pixel.

        Args:
            photos: Gaussians and masks, these counted from 0 in every photo; photos without pixels do not count.
            count: n.
            share: a Gaussian belongs to a mask that holds more than this of its pixels in the photo, at least 0.5.
        """
        members, seen, view_of_mask = [_NO_PAIRS], [_NO_PAIRS], []
        view = 0
        for rows, masks in photos:
            if not len(rows):
                continue
            of_view, showing = _members_of_photo(rows, masks, share)
            members.append(of_view + np.array([[0], [len(view_of_mask)]]))
            seen.append(np.stack([showing, np.full(len(showing), view)]))
            view_of_mask += [view] * (int(masks.max()) + 1)
            view += 1
        return MaskMembers(
            _build_ones(np.concatenate(members, axis=1), (count, len(view_of_mask))),
            _build_ones(np.concatenate(seen, axis=1), (count, view)),
            np.array(view_of_mask, np.int32),
        )


def find_mask_members(model: SceneModel, store: ViewStore, min_alpha: float, share: float) -> MaskMembers:
    """Look at every view that has masks; pixels outside all masks or with less than `min_alpha` opacity say nothing.

    The model is on the CPU; `share` as in `MaskMembers.from_pixels`. The same input gives the same bits,
    whatever the number of threads.
    """
    return MaskMembers.from_pixels(_find_shown(model, store, min_alpha), len(model), share)


def _find_shown(
    model: SceneModel, store: ViewStore, min_alpha: float
) -> Iterator[tuple[Int64[ndarray, " _"], Int64[ndarray, " _"]]]:
    """Find the top contributor and the mask of each pixel, one view after the other."""
    for number in range(len(store)):
        store.prefetch([(ahead, False) for ahead in range(number + 1, min(number + 3, len(store)))])
        view = store.get(number)
        if view.labels is None or not view.labels.any():
            continue
        pixels = _grid_pixels(view.labels)
        rows, gaussians = place_gaussians_in_view(model, view)
        top = find_top_contributors(*gaussians, view.camera, pixels, min_alpha)
        pixels, top = pixels[top >= 0], top[top >= 0]
        yield rows[top], np.unique(view.labels.ravel()[pixels], return_inverse=True)[1]
    store.release()


def _members_of_photo(
    rows: Integer[ndarray, " p"], masks: Integer[ndarray, " p"], share: float
) -> tuple[Int64[ndarray, "2 k"], Int64[ndarray, " s"]]:
    """Pairs of Gaussian and mask that belong together, and all Gaussians; both rising."""
    stride = int(masks.max()) + 1
    keys, pixels = np.unique(rows.astype(np.int64) * stride + masks, return_counts=True)
    gaussians, places = np.unique(keys // stride, return_inverse=True)
    belongs = pixels > share * np.bincount(places, weights=pixels)[places]
    return np.stack([keys // stride, keys % stride])[:, belongs], gaussians


def _grid_pixels(labels: Integer[ndarray, "h w"]) -> Int64[ndarray, " p"]:
    """Flat indices of the masked pixels on the grid, rising."""
    step = max(1, round(sqrt(labels.size / PIXELS_PER_VIEW)))
    shown = np.zeros(labels.shape, bool)
    shown[::step, ::step] = labels[::step, ::step] > 0
    return np.flatnonzero(shown)


def _build_ones(pairs: Int64[ndarray, "2 k"], shape: tuple[int, int]) -> csr_array:
    """Build a matrix of ones from distinct pairs of row and column; the columns of a row rise."""
    matrix = csr_array((np.ones(pairs.shape[1], np.float32), (pairs[0], pairs[1])), shape=shape)
    matrix.sort_indices()
    return matrix
