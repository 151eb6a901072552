"""Tracked objects as whole silhouettes: the gaps between an object's points (windows, dark paint) belong to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.masks.annotated.labelled_cloud import LabelledCloud
from instdrive_core.masks.image.point_drawing import NEAR, draw_points
from instdrive_core.scene.camera import Camera, CameraView

POINT_SIZE = 0.07
"""Metres that a point of an object stands for."""
MAX_DISTANCE = 120.0
CLOSING = 0.05
"""Radius of the closing relative to the object's size in the image."""
MAX_CLOSING = 8
BEHIND = 0.3
"""Metres by which an object may lie behind the surface around it and still be taken to be in front."""


@dataclass(frozen=True)
class _Silhouette:
    id: int
    top: int
    left: int
    inside: Bool[ndarray, "h w"]
    depths: Float32[ndarray, "h w"]


def draw_objects(
    cloud: LabelledCloud, view: CameraView, labels: UInt32[ndarray, "h w"], depths: Float32[ndarray, "h w"]
) -> None:
    """Draw the tracked objects of `cloud` as they stand at the view's time over a map of what stands still, in place.

    Args:
        cloud: models and tracks.
        view: camera and time.
        labels: IDs.
        depths: metres along the optical axis, infinity where nothing is.
    """
    objects = np.full(depths.shape, np.inf, np.float32)
    for number, track in cloud.tracks.items():
        if not track.covers(view.time):
            continue
        pose = track.interpolate_pose(view.time, view.camera.lag)
        found = _draw_silhouette(number, cloud.models[number], pose, track.dimensions, view.camera)
        if found is None:
            continue
        height, width = found.inside.shape
        crop = slice(found.top, found.top + height), slice(found.left, found.left + width)
        seen = found.inside & (found.depths < objects[crop]) & (found.depths < depths[crop] + BEHIND)
        labels[crop][seen] = number
        objects[crop][seen] = found.depths[seen]
    np.minimum(depths, objects, out=depths)


def _draw_silhouette(
    number: int, model: Float32[ndarray, "k 3"], pose: ndarray, dimensions: Float64[ndarray, "3"], camera: Camera
) -> _Silhouette | None:
    bounds = _compute_bounds(pose, dimensions, camera)
    if bounds is None:
        return None
    left, top, right, bottom = bounds
    crop = camera.crop(left, top, right, bottom)
    points = (model @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)
    _, depths = draw_points(points, np.full(len(points), number, np.uint32), crop, POINT_SIZE)
    drawn = np.isfinite(depths)
    if not drawn.any():
        return None
    radius = int(np.clip(round(CLOSING * max(drawn.shape)), 1, MAX_CLOSING))
    inside = ndimage.binary_closing(np.pad(drawn, radius), _build_disc(radius))[radius:-radius, radius:-radius]
    inside = np.asarray(ndimage.binary_fill_holes(inside | drawn))
    rows, columns = _find_nearest(drawn)
    return _Silhouette(number, top, left, inside, depths[rows, columns])


def _compute_bounds(
    pose: ndarray, dimensions: Float64[ndarray, "3"], camera: Camera
) -> tuple[int, int, int, int] | None:
    """Pixels (left, top, right, bottom) around the projected box; None where it is out of sight."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * (dimensions + 0.3)
    pixels, depths = camera.project(corners @ pose[:3, :3].T + pose[:3, 3])
    if depths.max() < NEAR or depths.min() > MAX_DISTANCE:
        return None
    if depths.min() < NEAR:  # a corner behind the camera projects anywhere: take the whole image
        return 0, 0, camera.width, camera.height
    left, top = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0).tolist()
    right, bottom = np.minimum(np.ceil(pixels.max(axis=0)).astype(int), (camera.width, camera.height)).tolist()
    return (left, top, right, bottom) if right > left and bottom > top else None


def _find_nearest(mask: Bool[ndarray, "h w"]) -> Int32[ndarray, "2 h w"]:
    """Row and column of the nearest set pixel of each pixel."""
    found = np.empty((2, *mask.shape), np.int32)
    ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True, indices=found)
    return found


def _build_disc(radius: int) -> Bool[ndarray, "d d"]:
    offsets = np.arange(-radius, radius + 1)
    return offsets[:, None] ** 2 + offsets[None, :] ** 2 <= (radius + 0.5) ** 2
