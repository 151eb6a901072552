"""Whether masks belong to the photos they are used with: their size, and whether their borders lie on edges."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError
from instdrive_core.masks.label_map_folder import SIDECAR, MaskFolder

LEAST_FIT = 1.03
"""Strength of the photo's edges on the masks' borders, against that beside them, below which they fit badly. Masks of
their own photos have 1.06 to 1.15, those of another clip 0.99 to 1.02."""
_LOOKED_AT = 12
"""Photos, spread over the clip."""
_LEAST_PHOTOS = 3
_LEAST_BORDER = 200
"""Pixels of borders in a photo."""
_ASIDE = 1 / 40
"""Share of the width by which borders are moved for comparison."""
_STRETCH = 0.03
"""Share by which the masks' sides may differ from the photo's, one against the other."""


def describe_misfit(clip: Clip, masks: MaskFolder) -> str | None:
    """Describe masks whose borders fit the clip's photos no better than those of another clip; None where they fit.

    Raises DataError where masks have another shape than their photo, or a file is damaged.
    """
    frames = [frame for frame in clip.training_frames if masks.counts.get(frame.key, 0) > 1]
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), _LOOKED_AT)).round().astype(int))
    fits = [fit for place in chosen if (fit := _measure_fit(frames[place], masks)) is not None]
    if len(fits) < _LEAST_PHOTOS or np.mean(fits) >= LEAST_FIT:
        return None
    return (
        f"{masks.path / SIDECAR}: the masks' borders do not lie on edges of the photos ({len(fits)} looked at): "
        f"the masks seem to be of another clip or other time steps. Write them again with `instdrive masks {clip.path}`"
    )


def _measure_fit(frame: Frame, masks: MaskFolder) -> float | None:
    """Mean rank of the photo's edges on the borders, divided by that beside them; None where there is little border."""
    camera = frame.view.camera
    labels = masks.load(frame.key).labels
    height, width = labels.shape
    if abs(width * camera.height / (height * camera.width) - 1) > _STRETCH:
        problem = f"the masks of '{frame.key}' are {width}×{height}, its photo {camera.width}×{camera.height}"
        remedy = f"Masks of another camera or clip? Write them again with `instdrive masks` for {frame.view.photo}"
        raise DataError(masks.path / SIDECAR, problem, remedy)
    border = _find_borders(masks.load(frame).labels)
    if border.sum() < _LEAST_BORDER:
        return None
    edges, aside = _rank_edges(frame), max(3, round(camera.width * _ASIDE))
    beside = [np.roll(edges, step, axis)[border].mean() for axis in (0, 1) for step in (-aside, aside)]
    return float(edges[border].mean() / max(np.mean(beside), 1e-6))


def _find_borders(labels: ndarray) -> Bool[ndarray, "h w"]:
    border = np.zeros(labels.shape, bool)
    border[:, 1:] = labels[:, 1:] != labels[:, :-1]
    border[1:] |= labels[1:] != labels[:-1]
    return border


def _rank_edges(frame: Frame) -> Float32[ndarray, "h w"]:
    """Strength of the photo's edges as their rank, 0 to 1, the strongest within a pixel's reach."""
    gray = ndimage.gaussian_filter(frame.load_image().mean(axis=2, dtype=np.float32), 1.0)
    strength = np.hypot(ndimage.sobel(gray, 0), ndimage.sobel(gray, 1))
    ranks = np.empty(strength.size, np.float32)
    ranks[np.argsort(strength, axis=None)] = np.linspace(0, 1, strength.size, dtype=np.float32)
    return ndimage.maximum_filter(ranks.reshape(strength.shape), 3)
