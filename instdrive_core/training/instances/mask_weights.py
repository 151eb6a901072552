"""Weight of each Gaussian in each mask of each photo: all that the affinity graph needs to know of a clip."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numba
import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64, Integer, UInt16
from numpy import ndarray
from scipy.sparse import csr_array

from instdrive_core.masks.label_map_folder import MAX_LAYERS
from instdrive_core.progress import report
from instdrive_core.rasterize.kernels.blend_weights import (
    BlendWeights,
    apply_weights,
    compact_weights,
    transpose_weights,
)
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.feature_weights import compute_view_weights
from instdrive_core.training.instances.weight_spool import ViewWeights, WeightSpool
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore

PIXELS_PER_VIEW = 32_768
"""About so many pixels of a photo are looked at, on a grid that is shifted from photo to photo."""


@dataclass(frozen=True)
class MaskWeights:
    """Summed blending weights, in pixels of the grid."""

    weights: csr_array
    """(n, m) float32: Gaussian × mask; the masks of a row rise. Those of a photo that shows most of a Gaussian in no
    mask count little: a mask beside it, frayed at its border, would speak for it else."""
    view_of_mask: Int32[ndarray, " m"]
    """Number of the label map that each mask lies in: number of the view times `layers`, plus the layer; rising."""
    layers: int = 1
    """Label maps of each view. Masks of one label map do not overlap."""
    unmasked: Float32[ndarray, " n"] | None = None
    """Weight of each Gaussian in pixels that no mask covers, sky and ego vehicle left out."""
    shown: Float32[ndarray, " n"] | None = None
    """Weight of each Gaussian in all pixels, whether in masks or in none; None where `unmasked` is, too."""

    def __len__(self) -> int:
        return len(self.weights.indptr) - 1

    def select_rows(self, rows: Integer[ndarray, " v"]) -> MaskWeights:
        """Select the given Gaussians."""
        unmasked, shown = (None if part is None else part[rows] for part in (self.unmasked, self.shown))
        return MaskWeights(self.weights[rows], self.view_of_mask, self.layers, unmasked, shown)

    def silence(self, rows: Bool[ndarray, " n"]) -> MaskWeights:
        """Give some Gaussians no weight, so that no mask is named after what they show."""
        data = np.where(np.repeat(rows, np.diff(self.weights.indptr)), np.float32(0), self.weights.data)
        matrix = csr_array((data, self.weights.indices, self.weights.indptr), self.weights.shape)
        parts = (self.unmasked, self.shown)
        unmasked, shown = (None if part is None else np.where(rows, np.float32(0), part) for part in parts)
        return MaskWeights(matrix, self.view_of_mask, self.layers, unmasked, shown)

    def sum_weights(self) -> Float32[ndarray, " n"]:
        """Sum the weight of each Gaussian over all masks."""
        return np.asarray(self.weights.sum(axis=1), np.float32).ravel()

    def sum_shown(self) -> Float32[ndarray, " n"]:
        """Sum each Gaussian's blending weight in all photos, whether in masks or in none."""
        return self.sum_weights() / self.layers if self.shown is None else self.shown

    def compute_unmasked_shares(self) -> Float32[ndarray, " n"]:
        """Compute the share of each Gaussian's weight that no mask covers; 0 where it was not seen."""
        if self.unmasked is None:
            return np.zeros(len(self), np.float32)
        return self.unmasked / np.maximum(self.sum_shown(), 1e-6)


def measure_mask_weights(model: SceneModel, store: ViewStore, min_alpha: float) -> MaskWeights:
    """Look at every view that has masks, layer by layer; pixels with less than `min_alpha` opacity are left out.

    Reports its progress (`progress.report`).

    The model is on the CPU. The same input gives the same bits, whatever the number of threads.
    """
    with WeightSpool(len(model)) as spool:
        view_of_mask, layers, unmasked, shown = _look_at_views(model, store, min_alpha, spool)
        numbers = np.array(view_of_mask, np.int32)
        numbers = numbers // MAX_LAYERS * layers + numbers % MAX_LAYERS
        return MaskWeights(spool.build_matrix(len(view_of_mask)), numbers, layers, unmasked, shown)


def _look_at_views(
    model: SceneModel, store: ViewStore, min_alpha: float, spool: WeightSpool
) -> tuple[list[int], int, Float32[ndarray, " n"], Float32[ndarray, " n"]]:
    """Put the weights of all views into `spool`.

    Returns the label map of each mask, numbered by view times `MAX_LAYERS` plus layer; the most layers of a view; and
    the weight of each Gaussian in no mask and in all.
    """
    view_of_mask: list[int] = []
    unmasked, shown = np.zeros(len(model), np.float32), np.zeros(len(model), np.float32)
    layers = 1
    for number in range(len(store)):
        report(number / len(store))
        store.prefetch([(ahead, False) for ahead in range(number + 1, min(number + 3, len(store)))])
        view = store.get(number)
        if not any(layer.any() for layer in view.layers):
            continue
        layers = max(layers, len(view.layers))
        rows, weights, pixels = look_at_grid(model, view, number, min_alpha)
        labels = [layer.ravel()[pixels] for layer in view.layers]
        of_view = np.bincount(weights.rows, weights.weights, len(rows))
        shown[rows] += of_view.astype(np.float32)
        for layer, labels_of_pixels in enumerate(labels):
            local, masks, values, count = _sum_in_masks(weights, labels_of_pixels, len(rows))
            covered = np.bincount(local, values, len(rows)) / np.maximum(of_view, 1e-9)
            values *= covered[local].astype(np.float32)
            used, counts = np.unique(rows[local].astype(np.int32), return_counts=True)
            spool.add(ViewWeights(used, counts.astype(np.int32), masks + np.int32(len(view_of_mask)), values))
            view_of_mask += [number * MAX_LAYERS + layer] * count
        bare = weights.select_pixels(~np.any(labels, axis=0))
        unmasked[rows] += np.bincount(bare.rows, bare.weights, len(rows)).astype(np.float32)
    store.release()
    return view_of_mask, layers, unmasked, shown


def look_at_grid(
    model: SceneModel, view: TrainingView, number: int, min_alpha: float
) -> tuple[Int64[ndarray, " v"], BlendWeights, Int64[ndarray, " p"]]:
    """Look at a grid of pixels of the number-th view, which is shifted from view to view. The model is on the CPU.

    Returns the rows of Gaussians that the view may show, their weights in those pixels of the grid that have at least
    `min_alpha` opacity, and these pixels, flat and rising.
    """
    pixels = _list_grid_pixels(view, number)
    rows, weights = compute_view_weights(model, view, pixels)
    alpha = apply_weights(weights, np.ones((len(rows), 1), np.float32))[:, 0]
    return rows, weights.select_pixels(alpha >= min_alpha), pixels[alpha >= min_alpha]


def _sum_in_masks(
    weights: BlendWeights, labels: UInt16[ndarray, " p"], size: int
) -> tuple[Int64[ndarray, " k"], Int32[ndarray, " k"], Float32[ndarray, " k"], int]:
    """Gaussians, masks counted from 0 and weights of one label map, sorted by Gaussian, then mask; number of masks."""
    used, weights = compact_weights(weights.select_pixels(labels > 0), size)
    present, mask_of_pixel = np.unique(labels[labels > 0], return_inverse=True)
    by_gaussian = transpose_weights(weights, len(used))
    arrays = (by_gaussian.indptr, by_gaussian.rows, by_gaussian.weights, mask_of_pixel.astype(np.int32))
    local, masks, values = _sums_by_mask(*arrays, len(present))
    return used[local], masks, values.copy(), len(present)  # a slice would keep the room for all pixels in memory


def _list_grid_pixels(view: TrainingView, number: int) -> Int64[ndarray, " p"]:
    """Flat indices of the pixels on the view's grid that a mask covers, or else could cover, rising."""
    shape = view.image.shape[:2]
    step = max(1, round(sqrt(shape[0] * shape[1] / PIXELS_PER_VIEW)))
    top, left = number % step, number // step % step
    on_grid = np.zeros(shape, bool)
    on_grid[top::step, left::step] = True
    could_be = np.ones(shape, bool) if view.sky is None else ~view.sky
    if view.valid is not None:
        could_be &= view.valid
    return np.flatnonzero(on_grid & (could_be | np.any(view.layers, axis=0)))


@numba.njit(cache=True, error_model="numpy")
def _sums_by_mask(starts, pixels, weights, mask_of_pixel, count):
    """Row, mask and summed weight of each pair that has any, sorted by row, then mask."""
    size = len(pixels)
    rows, masks, values = np.empty(size, np.int32), np.empty(size, np.int32), np.empty(size, np.float32)
    sums, found = np.zeros(count, np.float32), 0
    for row in range(len(starts) - 1):
        first = found
        for entry in range(starts[row], starts[row + 1]):
            mask = mask_of_pixel[pixels[entry]]
            if sums[mask] == 0:
                rows[found], masks[found] = row, mask
                found += 1
            sums[mask] += weights[entry]
        masks[first:found].sort()
        for entry in range(first, found):
            values[entry] = sums[masks[entry]]
            sums[masks[entry]] = 0
    return rows[:found], masks[:found], values[:found]
