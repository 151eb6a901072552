"""Where boxes appear in a view."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera
from instdrive_core.scene.track import Track


def box_silhouette(
    camera: Camera, world_from_box: Float64[ndarray, "4 4"], dimensions: Float64[ndarray, "3"]
) -> Bool[ndarray, "h w"]:
    """Pixels whose centre ray meets the box in front of the camera; occluders are not considered.

    Slab test (Kay and Kajiya 1986) in the box's frame, so boxes beside and around the camera are right as well.
    """
    rotation, center = world_from_box[:3, :3], world_from_box[:3, 3]
    directions = camera.ray_directions() @ rotation
    directions = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
    start = (camera.position - center) @ rotation
    half = np.asarray(dimensions) / 2
    first, second = (-half - start) / directions, (half - start) / directions
    enter = np.minimum(first, second).max(axis=-1)
    leave = np.maximum(first, second).min(axis=-1)
    return (leave > 0) & (enter <= leave)


def moving_box_pixels(camera: Camera, tracks: Iterable[Track], time: float) -> Bool[ndarray, "h w"]:
    """Pixels that show the boxes of moving objects at `time` (seconds)."""
    shown = np.zeros((camera.height, camera.width), bool)
    for track in tracks:
        if track.moving and track.covers(time):
            shown |= box_silhouette(camera, track.pose_at(time), track.dimensions)
    return shown
