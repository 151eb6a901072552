"""Pictures whose lines are exposed one after the other, while the camera and the traffic move on.

Each splat is put where the camera sees it at the moment of the line that it falls on, seen from the camera's place at
the picture's middle. Then one ordinary picture shows them all, and depth, masks and winners agree with it. Where a
splat stands in the camera's axes is taken as quadratic in time, through the start, the middle and the end. Splats are
moved, not stretched: what moves along with the exposed line, as things beside the road do where lines are columns, is
drawn with splats that are up to a tenth too narrow or too wide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from instdrive_core.rasterize.kernels.skew import skew_means
from instdrive_core.rasterize.kernels.sky_behind import render_sky_behind
from instdrive_core.rasterize.preview import Preview
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene

Direction = Literal["down", "right", "up", "left"]
"""Which way the exposed line goes over the picture."""
_SKY_LINES = 8
"""Lines that show the sky from one moment."""


@dataclass(frozen=True)
class RollingCamera:
    """A camera that moves while its lines are exposed."""

    camera: Camera
    """At the middle of the picture."""
    start: Float64[ndarray, "4 4"]
    """world_from_camera when the first line is exposed."""
    end: Float64[ndarray, "4 4"]
    """world_from_camera when the last line is."""
    start_time: float
    """Seconds."""
    end_time: float
    direction: Direction = "down"

    @property
    def time(self) -> float:
        """Seconds at the middle of the picture."""
        return (self.start_time + self.end_time) / 2

    @property
    def is_upright(self) -> bool:
        """Whether lines are rows."""
        return self.direction in ("down", "up")


def view_through_shutter(scene: Scene, rolling: RollingCamera) -> Preview:
    """Draw the scene as `view_scene` does, each line at its own moment."""
    return view_skewed(skew_scene(scene, rolling), rolling)


def view_skewed(skewed: Scene, rolling: RollingCamera) -> Preview:
    """Draw what `skew_scene` made of a scene; the sky is shown by lines, too."""
    frame = view_scene(replace(skewed, sky=None), rolling.camera, rolling.time)
    return frame if skewed.sky is None else replace(frame, color=frame.color + _show_sky(skewed, rolling, frame.alpha))


def skew_scene(scene: Scene, rolling: RollingCamera) -> Scene:
    """Put each splat where the camera at the picture's middle sees it as its own line does.

    The scene returned is good for pictures of `rolling.camera` at `rolling.time` only.
    """
    camera, means = rolling.camera, np.ascontiguousarray(scene.gaussians.means)
    moments = (
        (rolling.start, rolling.start_time),
        (camera.world_from_camera, rolling.time),
        (rolling.end, rolling.end_time),
    )
    camera_from_node = np.stack([np.linalg.inv(pose) @ scene.find_node_poses(time)[0] for pose, time in moments])
    node_from_camera = np.linalg.inv(camera_from_node[1])
    if rolling.is_upright:
        lens = camera.fy / camera.height, camera.cy / camera.height, 1
    else:
        lens = camera.fx / camera.width, camera.cx / camera.width, 0
    skewed, backwards = np.empty_like(means), rolling.direction in ("up", "left")
    skew_means(means, scene.nodes, camera_from_node, node_from_camera, lens, backwards, skewed)
    return replace(scene, gaussians=replace(scene.gaussians, means=skewed))


def _show_sky(scene: Scene, rolling: RollingCamera, alpha: Float32[ndarray, "h w"]) -> Float32[ndarray, "h w 3"]:
    """The sky behind a picture, some lines at a time."""
    camera, behind = rolling.camera, np.zeros((*alpha.shape, 3), np.float32)
    lines = camera.height if rolling.is_upright else camera.width
    turns = quaternion_from_matrix(np.stack([rolling.start[:3, :3], rolling.end[:3, :3]]))
    for first in range(0, lines, _SKY_LINES):
        last = min(first + _SKY_LINES, lines)
        share = (first + last) / 2 / lines
        share = 1 - share if rolling.direction in ("up", "left") else share
        pose = camera.world_from_camera.copy()
        pose[:3, :3] = matrix_from_quaternion(slerp(turns[0], turns[1], share))
        if rolling.is_upright:
            part = replace(camera, cy=camera.cy - first, height=last - first, world_from_camera=pose)
            behind[first:last] = render_sky_behind(scene.sky, part, alpha[first:last])
        else:
            part = replace(camera, cx=camera.cx - first, width=last - first, world_from_camera=pose)
            behind[:, first:last] = render_sky_behind(scene.sky, part, np.ascontiguousarray(alpha[:, first:last]))
    return behind
