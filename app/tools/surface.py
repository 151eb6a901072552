"""The point of the scene under a pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, UInt32
from numpy import ndarray

from instdrive_app.state import FrameSnapshot
from instdrive_core.edits.document.document import Document

WinnerReader = Callable[[FrameSnapshot], UInt32[ndarray, "h w"]]
"""Returns row + 1 of the splat that each pixel of a frame stands for, 0 for none."""


@dataclass(frozen=True)
class SurfacePoint:
    """Where the ray through a pixel meets what the pixel shows."""

    place: Float64[ndarray, "3"]
    """Metres, in the world."""
    distance: float
    """Metres from the camera, along its axis."""
    row: int
    """The splat that the pixel stands for."""


def find_surface(
    document: Document, winners: WinnerReader, snapshot: FrameSnapshot, x: float, y: float
) -> SurfacePoint | None:
    """Find the point under a pixel: on its ray, as deep as the middle of the splat it stands for. None for nothing."""
    seen = winners(replace(snapshot, draft=False))
    height, width = seen.shape
    row = int(seen[int(np.clip(y, 0, height - 1)), int(np.clip(x, 0, width - 1))]) - 1
    if row < 0 or row >= len(document.scene):
        return None
    poses, _ = document.scene.find_node_poses(snapshot.time, snapshot.camera.lag)
    pose = poses[document.scene.nodes[row]]
    middle = pose[:3, :3] @ document.compute_means(np.array([row]))[0] + pose[:3, 3]
    camera = snapshot.camera
    depth = float(camera.camera_from_world[2, :3] @ middle + camera.camera_from_world[2, 3])
    local = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]) * depth
    return SurfacePoint(camera.world_from_camera[:3, :3] @ local + camera.position, depth, row)
