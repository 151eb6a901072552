"""Pixels of a view that show boxes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from instdrive_core.scene.camera import Camera
from instdrive_core.scene.track import Track


def find_box_silhouette(
    camera: Camera, world_from_box: Float64[ndarray, "4 4"], dimensions: Float64[ndarray, "3"]
) -> Bool[ndarray, "h w"]:
    """Find pixels whose centre ray meets the box in front of the camera; occluders are not considered.

    Slab test (Kay and Kajiya 1986) in the box's frame, so boxes beside and around the camera are right as well.
    """
    half = np.asarray(dimensions) / 2
    silhouette = np.zeros((camera.height, camera.width), bool)
    pixels = _list_pixels_around(camera, world_from_box, half)
    directions = camera.compute_pixel_rays(pixels) @ world_from_box[:3, :3]
    directions = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
    start = (camera.position - world_from_box[:3, 3]) @ world_from_box[:3, :3]
    first, second = (-half - start) / directions, (half - start) / directions
    enter = np.minimum(first, second).max(axis=1)
    leave = np.maximum(first, second).min(axis=1)
    silhouette.ravel()[pixels] = (leave > 0) & (enter <= leave)
    return silhouette


def find_moving_box_pixels(camera: Camera, tracks: Iterable[Track], time: float) -> Bool[ndarray, "h w"]:
    """Find pixels that show the boxes of moving objects at the time step `time` (seconds)."""
    shown = np.zeros((camera.height, camera.width), bool)
    for track in tracks:
        if track.moving and track.covers(time):
            shown |= find_box_silhouette(camera, track.interpolate_pose(time, camera.lag), track.dimensions)
    return shown


def _list_pixels_around(
    camera: Camera, world_from_box: Float64[ndarray, "4 4"], half: Float64[ndarray, "3"]
) -> Int64[ndarray, " p"]:
    """List flat indices of a rectangle that holds the whole silhouette; corners behind the camera leave no smaller one
    than the image."""
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    corners, depths = camera.project(signs * half @ world_from_box[:3, :3].T + world_from_box[:3, 3])
    if (depths <= 0).all():
        return np.zeros(0, np.int64)
    size = np.array([camera.width, camera.height])
    low, high = np.zeros(2, np.int64), size
    if (depths > 0).all():
        low = np.clip(np.floor(corners.min(axis=0)), 0, size).astype(np.int64)
        high = np.clip(np.ceil(corners.max(axis=0)), 0, size).astype(np.int64)
    rows, columns = np.arange(low[1], high[1]), np.arange(low[0], high[0])
    return (rows[:, None] * camera.width + columns).ravel()
