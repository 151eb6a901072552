"""Turning, scaling and shifting what a scene holds beside its splats: poses, tracks, cameras, sky and boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_core.instances.table import Bounds
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.sky import Sky, compute_texel_directions
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import Similarity, extract_scale


def transform_pose(pose: Float[ndarray, "*n 4 4"], matrix: Similarity) -> Float[ndarray, "*n 4 4"]:
    """Transform rigid poses by [s R | t]: frames are turned and moved, their own unit stays a metre."""
    result = pose.copy()
    result[..., :3, :3] = matrix[:, :3] / extract_scale(matrix) @ pose[..., :3, :3]
    result[..., :3, 3] = pose[..., :3, 3] @ matrix[:, :3].T + matrix[:, 3]
    return result


def transform_track(track: Track, matrix: Similarity) -> Track:
    """Transform a track by [s R | t]: all its poses, and a box that becomes s times as large."""
    poses = transform_pose(track.world_from_box, matrix)
    return replace(track, world_from_box=poses, dimensions=track.dimensions * extract_scale(matrix))


def transform_view(view: CameraView, matrix: Similarity) -> CameraView:
    """Transform a photo's camera by [s R | t]; it sees the same picture of a scene that is transformed with it."""
    camera, pose = view.camera, transform_pose(view.camera.world_from_camera, matrix)
    lag = None if camera.lag is None else camera.lag.transform(matrix)
    return replace(view, camera=replace(camera, world_from_camera=pose, lag=lag))


def rotate_sky(sky: Sky, rotation: Float[ndarray, "3 3"]) -> Sky:
    """Rotate a sky to show along d what it showed along Rᵀ d; exact for quarter turns, else sampled between texels."""
    directions = compute_texel_directions(sky.faces.shape[1])
    # Row by row, as d R = Rᵀ d.
    return Sky(sky.sample(directions @ np.asarray(rotation, np.float64)))


def transform_bounds(bounds: Bounds, matrix: Similarity) -> Bounds:
    """Compute the box around a box after [s R | t]; it fits as tightly as before where R is a quarter turn."""
    low, high = transform_boxes(np.array(bounds)[None], matrix)[0].tolist()
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def transform_boxes(boxes: Float[ndarray, "k 2 3"], matrix: Similarity) -> Float64[ndarray, "k 2 3"]:
    """Compute the boxes around many boxes after [s R | t]; each has its lower corner first."""
    spans = matrix[:, :3] * boxes[:, :, None]  # box, end of it, axis of the result, axis of the box
    return np.stack([spans.min(axis=1).sum(axis=2), spans.max(axis=1).sum(axis=2)], axis=1) + matrix[:, 3]
