"""Optical flow of a recorded picture: where each pixel's surface is in the same camera's next picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from numpy import ndarray

from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.scene import Scene

_NEAR = 0.01
"""Metres in front of the next camera below which a surface is not in its picture."""


@dataclass(frozen=True)
class FlowField:
    """Motion of each pixel's surface, whether or not something hides it in the next picture."""

    flow: Float32[ndarray, "h w 2"]
    """Pixels to the right and down; 0 where it is not known."""
    valid: Bool[ndarray, "h w"]
    """False where the surface is behind the next camera, or its actor is not there any more."""


def compute_flow(
    scene: Scene, view: CameraView, following: CameraView, depth: Float32[ndarray, "h w"], winner: Int32[ndarray, "h w"]
) -> FlowField:
    """Compute the flow from a view to the following one of the same camera.

    Surfaces move with the node of the splat that their pixel stands for; what has no depth lies infinitely far away.

    Args:
        depth: metres along the viewing axis, 0 where nothing is.
        winner: row of the splat that each pixel stands for, -1 for none.
    """
    camera, poses = view.camera, scene.find_node_poses(view.time)[0]
    later, present = scene.find_node_poses(following.time)
    nodes = np.where(winner >= 0, scene.nodes[winner], 0) if len(scene) else np.zeros(winner.shape, np.uint16)
    rays = _list_rays(camera)
    points = rays * depth.reshape(-1, 1).astype(np.float64)
    places = points @ camera.world_from_camera[:3, :3].T + camera.position
    flat, known = nodes.reshape(-1), np.ones(depth.size, bool)
    for node in np.unique(flat[flat > 0]).tolist():
        chosen = np.flatnonzero(flat == node)
        moved = later[node] @ np.linalg.inv(poses[node])
        places[chosen] = places[chosen] @ moved[:3, :3].T + moved[:3, 3]
        known[chosen] = present[node] != 0
    matrix = following.camera.camera_from_world
    local = places @ matrix[:3, :3].T + matrix[:3, 3]
    far = depth.reshape(-1) <= 0
    local[far] = rays[far] @ (matrix[:3, :3] @ camera.world_from_camera[:3, :3]).T
    valid = known & (local[:, 2] > _NEAR)
    pixels = local[:, :2] / np.where(valid, local[:, 2], 1.0)[:, None]
    target = following.camera
    pixels = pixels * [target.fx, target.fy] + [target.cx, target.cy]
    flow = np.where(valid[:, None], pixels - _list_centres(camera), 0).astype(np.float32)
    return FlowField(flow.reshape(*depth.shape, 2), valid.reshape(depth.shape))


def _list_centres(camera: Camera) -> Float64[ndarray, "p 2"]:
    rows, columns = np.mgrid[: camera.height, : camera.width]
    return np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=1)


def _list_rays(camera: Camera) -> Float64[ndarray, "p 3"]:
    """Directions in the camera's frame with z 1."""
    centres = _list_centres(camera)
    x, y = (centres[:, 0] - camera.cx) / camera.fx, (centres[:, 1] - camera.cy) / camera.fy
    return np.stack([x, y, np.ones(len(centres))], axis=1)
