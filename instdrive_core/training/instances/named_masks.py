"""Masks named after the objects that they show, so that objects' edges can be learned in the RGB stage.

An edge is learned without a feature: in each step every object gets a random tag of ±1 in a few channels, tags are
blended like colours, and a pixel in an object's mask should show its tag alone. Whatever two objects share a pixel,
their tags differ in most steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int32, Int64, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.masks.label_map_folder import MAX_LAYERS
from instdrive_core.rasterize.kernels.blend_weights import BlendWeights
from instdrive_core.training.gaussians.first_shadows import find_model_shadows
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.instance_learner import LearnedInstances
from instdrive_core.training.instances.mask_weights import look_at_grid
from instdrive_core.training.views.view_store import ViewStore

TAG_CHANNELS = 3
"""Channels of a tag: two objects have the same one in an eighth of the steps."""


@dataclass(frozen=True)
class ObjectTags:
    """Tags of one step: those of the Gaussians, and those that a view's pixels should show. Tensors on one device."""

    of_gaussians: Float[Tensor, "n c"]
    """Tags, then 1 for shadows of moving objects, whose tags are 0, and 0 for all others: c = t + 1."""
    wanted: Float[Tensor, "h w t"]
    known: Bool[Tensor, "h w"]
    """Pixels in masks that teach edges."""


@dataclass(frozen=True)
class NamedMasks:
    """The object of each Gaussian, and of each mask the object that it shows best."""

    objects: Int64[ndarray, " n"]
    """0 … k - 1 of each Gaussian."""
    maps: Int32[ndarray, " m"]
    """Label map of each mask: number of the view times `MAX_LAYERS`, plus the layer; rising."""
    labels: Int32[ndarray, " m"]
    """Label of the mask there."""
    owners: Int64[ndarray, " m"]
    """Object with the largest IoU in the photo, by blending weight."""
    fits: Float32[ndarray, " m"]
    """That IoU."""
    shadows: Bool[ndarray, " n"]
    """The Gaussians that are shadows of moving objects."""

    def find_owners(
        self, number: int, layers: Sequence[UInt16[ndarray, "h w"]], min_fit: float
    ) -> Int64[ndarray, "h w"]:
        """Find the object of each pixel of a view: that of the mask there which fits its object best.

        -1 where no mask with an IoU of at least `min_fit` lies.
        """
        owners = np.full(layers[0].shape, -1, np.int64)
        best = np.full(layers[0].shape, min_fit, np.float32)
        for layer, labels in enumerate(layers):
            masks = np.flatnonzero(self.maps == number * MAX_LAYERS + layer)
            size = max(int(labels.max(initial=0)), int(self.labels[masks].max(initial=0))) + 1
            owner_of, fit_of = np.full(size, -1, np.int64), np.full(size, -1, np.float32)
            owner_of[self.labels[masks]], fit_of[self.labels[masks]] = self.owners[masks], self.fits[masks]
            fits = fit_of[labels]
            better = fits >= best
            owners[better], best[better] = owner_of[labels[better]], fits[better]
        return owners

    def draw_tags(
        self,
        number: int,
        layers: Sequence[UInt16[ndarray, "h w"]],
        min_fit: float,
        rng: np.random.Generator,
        device: torch.device,
    ) -> ObjectTags | None:
        """Draw random tags for one step on a view, None where no mask of it fits its object well enough.

        Shadows of moving objects have none: a mask shows what they fall on.
        """
        if not layers:
            return None
        owners = self.find_owners(number, layers, min_fit)
        known = owners >= 0
        if not known.any():
            return None
        count = int(self.objects.max(initial=0)) + 1
        tags = (2 * rng.integers(0, 2, (count, TAG_CHANNELS)) - 1).astype(np.float32)
        shadow = self.shadows.astype(np.float32)[:, None]
        arrays = np.hstack([tags[self.objects] * (1 - shadow), shadow]), tags[owners], known
        return ObjectTags(*(torch.from_numpy(array).to(device) for array in arrays))

    def to_tensors(self) -> dict[str, Tensor]:
        """Write the arrays as tensors of a checkpoint, by name."""
        return {name: torch.from_numpy(array) for name, array in vars(self).items()}

    @staticmethod
    def from_tensors(tensors: dict[str, Tensor]) -> NamedMasks:
        """Read what `to_tensors` wrote."""
        arrays = {name: value.numpy() for name, value in tensors.items()}
        none = np.zeros(len(arrays["objects"]), bool)  # of checkpoints that know no shadows
        return NamedMasks(**{"shadows": none, **arrays})


MaskNamer = Callable[[SceneModel, ViewStore], NamedMasks]
"""Names the masks of a store's views, by a model on the CPU."""


def name_masks(model: SceneModel, store: ViewStore, learned: LearnedInstances, min_alpha: float) -> NamedMasks:
    """Name every mask after the object with the largest IoU in its photo, counted in blending weight on a grid.

    Args:
        model: the scene, on the CPU.
        store: photos with masks.
        learned: the objects: a codeword each.
        min_alpha: pixels with less opacity are left out.
    """
    shadows = find_model_shadows(model)
    objects = np.unique(learned.codewords, return_inverse=True)[1].astype(np.int64)
    count = int(objects.max(initial=-1)) + 1
    found: list[tuple[int, Int32[ndarray, " k"], Int64[ndarray, " k"], Float32[ndarray, " k"]]] = []
    for number in range(len(store)):
        store.prefetch([(ahead, False) for ahead in range(number + 1, min(number + 3, len(store)))])
        view = store.get(number)
        if not any(layer.any() for layer in view.layers):
            continue
        rows, weights, pixels = look_at_grid(model, view, number, min_alpha)
        for layer, labels in enumerate(view.layers):
            present, sums = _sum_by_mask(weights, objects[rows], ~shadows[rows], labels.ravel()[pixels], count)
            union = sums.sum(axis=1, keepdims=True) + sums.sum(axis=0, keepdims=True) - sums
            ious = sums / np.maximum(union, 1e-6)
            owners = np.argmax(ious, axis=1)
            fits = ious[np.arange(len(ious)), owners].astype(np.float32)
            found.append((number * MAX_LAYERS + layer, present, owners, fits))
    maps = [np.full(len(present), number, np.int32) for number, present, _, _ in found]
    return NamedMasks(
        objects,
        np.concatenate([np.zeros(0, np.int32), *maps]),
        np.concatenate([np.zeros(0, np.int32), *(present for _, present, _, _ in found)]),
        np.concatenate([np.zeros(0, np.int64), *(owners for _, _, owners, _ in found)]),
        np.concatenate([np.zeros(0, np.float32), *(fits for _, _, _, fits in found)]),
        shadows,
    )


def _sum_by_mask(
    weights: BlendWeights,
    objects: Int64[ndarray, " v"],
    solid: Bool[ndarray, " v"],
    labels: UInt16[ndarray, " p"],
    count: int,
) -> tuple[Int32[ndarray, " k"], ndarray]:
    """Labels of the masks that the pixels lie in, rising, and the weight of each of `count` objects in each."""
    inside = weights.select_pixels(labels > 0)
    present, mask_of_pixel = np.unique(labels[labels > 0], return_inverse=True)
    masks = np.repeat(mask_of_pixel, np.diff(inside.indptr))
    flat = np.bincount(masks * count + objects[inside.rows], inside.weights * solid[inside.rows], len(present) * count)
    return present.astype(np.int32), flat.reshape(len(present), count)
