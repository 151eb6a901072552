"""A whole scene seen by a camera at a time: actors placed, sky behind."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
from jaxtyping import Bool, Float32, UInt32
from numpy import ndarray

from instdrive_core.rasterize.layout import kernel_array
from instdrive_core.rasterize.preview import DEFAULT_PICK_RULE, PickRule, Preview, preview
from instdrive_core.rasterize.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.rasterize.view_colors import view_colors
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene, placed
from instdrive_core.scene.sky import cube_tap


def view_scene(
    scene: Scene,
    camera: Camera,
    time: float,
    drawn: Bool[ndarray, " n"] | None = None,
    settings: RasterSettings = DEFAULT_SETTINGS,
    rule: PickRule = DEFAULT_PICK_RULE,
) -> Preview:
    """Draw the scene as it is at `time` (seconds); its colour has the sky, or black, behind it.

    Args:
        drawn: mask of the splats to draw, as `SplatState.drawn` gives it; all by default. Actors that do not exist
            at `time` are not drawn either.
    """
    gaussians = scene.gaussians
    poses, present = scene.at(time)
    means, quats = placed(gaussians.means, gaussians.quats, scene.nodes, poses)
    colors = view_colors(means, gaussians.sh_dc, gaussians.sh_rest, camera.position, scene.nodes, poses)
    opacities = gaussians.opacities
    if drawn is not None:
        opacities = np.where(drawn, opacities, np.float32(0))
    if not present.all():
        opacities = np.where(present[scene.nodes], opacities, np.float32(0))
    frame = preview(means, quats, gaussians.log_scales, opacities, colors, camera, settings, rule)
    return replace(frame, color=frame.color + sky_behind(scene, camera, frame.alpha))


def sky_behind(scene: Scene, camera: Camera, alpha: Float32[ndarray, "h w"]) -> Float32[ndarray, "h w 3"]:
    """What the sky adds to each pixel: its colour where the Gaussians let light through, black without a sky."""
    behind = np.zeros((*alpha.shape, 3), np.float32)
    if scene.sky is not None:
        faces = kernel_array(scene.sky.faces)
        pinhole = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        rotation = np.ascontiguousarray(camera.world_from_camera[:3, :3])
        _sky_behind(faces.reshape(-1, 3), faces.shape[1], pinhole, rotation, alpha, behind)
    return behind


def instance_map(scene: Scene, frame: Preview) -> UInt32[ndarray, "h w"]:
    """The instance that each pixel stands for, 0 for none."""
    if not len(scene):
        return np.zeros(frame.winner.shape, np.uint32)
    return np.where(frame.winner >= 0, scene.instance_ids[frame.winner], 0).astype(np.uint32)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _sky_behind(texels, resolution, pinhole, rotation, alpha, behind):
    height, width = alpha.shape
    for row in numba.prange(height):
        indices, weights = np.empty(4, np.int64), np.empty(4, np.float32)
        y = (row + 0.5 - pinhole[3]) / pinhole[1]
        for column in range(width):
            through = np.float32(1) - alpha[row, column]
            if through <= 0:
                continue
            x = (column + 0.5 - pinhole[2]) / pinhole[0]
            dx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]
            dy = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]
            dz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
            cube_tap(dx, dy, dz, resolution, indices, weights)
            for tap in range(4):
                for channel in range(3):
                    behind[row, column, channel] += through * weights[tap] * texels[indices[tap], channel]
