"""Sky among a photo's masks: those that LiDAR looks through, or else those that look and lie like it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, UInt8, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip
from instdrive_core.masks.image.point_drawing import draw_points
from instdrive_core.masks.image.sky import LOWEST_SKY, MAX_CONTRAST
from instdrive_core.masks.image.sky_search import SkySearch
from instdrive_core.scene.camera import Camera

POINT_SIZE = 0.2
"""Metres: LiDAR points are thinned to one per cell of this size, and drawn as large."""
SEEN_THROUGH = 0.5
"""Share of a mask through which LiDAR looks, from which on it is the sky."""
ABOVE_HORIZON, SMOOTH = 0.95, 0.9
"""Without LiDAR: shares of a sky's pixels above the horizon, and of those inside of it without strong contrast."""
LARGEST_OBJECT = 0.5
"""Share of the photo beyond which a mask may hold the sky and something else."""


class SkyFinder:
    """Finds the sky in a clip's photos.

    Args:
        clip: the clip; sweeps of held-out time steps are not used.
    """

    def __init__(self, clip: Clip) -> None:
        self._points = _gather_points(clip)
        self._search: SkySearch | None = None
        if len(self._points):
            self._search = SkySearch(clip, lambda frame: self._find_supported(frame.view.camera))

    def find(
        self, image: UInt8[ndarray, "h w 3"], camera: Camera, labels: UInt32[ndarray, "h w"]
    ) -> Bool[ndarray, "h w"]:
        """Find the sky of a photo whose masks are `labels` (0 = none).

        Where the clip has LiDAR, masks give the sky its border, and sky that no mask claims is found as well.
        """
        if self._search is None:
            return find_sky_by_looks(image, camera, labels)
        seeds = self._search.find_seeds(self._find_supported(camera), image, camera)
        sizes = np.bincount(labels.ravel())
        seen_through = np.bincount(labels[seeds], minlength=len(sizes))
        is_sky = seen_through > SEEN_THROUGH * sizes
        undecided = sizes > LARGEST_OBJECT * labels.size
        is_sky[0] = False
        undecided[0] = True
        return is_sky[labels] | (seeds & undecided[labels])

    def _find_supported(self, camera: Camera) -> Bool[ndarray, "h w"]:
        """Find pixels in which LiDAR met a surface at any time."""
        ids = np.ones(len(self._points), np.uint32)
        return draw_points(self._points, ids, camera, POINT_SIZE)[0] > 0


def find_sky_by_looks(
    image: UInt8[ndarray, "h w 3"], camera: Camera, labels: UInt32[ndarray, "h w"]
) -> Bool[ndarray, "h w"]:
    """Find masks that reach the photo's upper edge, lie above the horizon, are smooth and brighter than the photo is
    below the horizon."""
    above = camera.compute_ray_directions()[..., 2] > np.sin(np.radians(LOWEST_SKY))
    grey = image.mean(axis=2)
    smooth = ndimage.maximum_filter(grey, 3) - ndimage.minimum_filter(grey, 3) < MAX_CONTRAST
    ground = grey[~above].mean() if not above.all() else grey.mean()
    sky = np.zeros(labels.shape, bool)
    for label in np.unique(labels[0][labels[0] > 0]):
        mine = labels == label
        inside = np.zeros_like(mine)  # without the border, which contrasts with what is beyond it
        ndimage.minimum_filter(mine, 3, output=inside, mode="nearest")
        is_smooth = inside.any() and smooth[inside].mean() >= SMOOTH
        if is_smooth and above[mine].mean() >= ABOVE_HORIZON and grey[mine].mean() > ground:
            sky |= mine
    return sky


def _gather_points(clip: Clip) -> Float32[ndarray, "n 3"]:
    """Gather the points of all sweeps that may be used, thinned."""
    parts = [_thin_points(sweep.load().points) for sweep in clip.training_sweeps]
    return _thin_points(np.concatenate([np.zeros((0, 3), np.float32), *parts]))


def _thin_points(points: Float32[ndarray, "n 3"]) -> Float32[ndarray, "m 3"]:
    """Keep the first point of each cell."""
    if not len(points):
        return points
    cells = np.floor(points / POINT_SIZE).astype(np.int64)
    cells -= cells.min(axis=0)
    _, size_y, size_z = cells.max(axis=0) + 1
    _, first = np.unique((cells[:, 0] * size_y + cells[:, 1]) * size_z + cells[:, 2], return_index=True)
    return points[first]
