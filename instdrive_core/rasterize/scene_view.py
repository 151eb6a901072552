"""A whole scene seen by a camera at a time: actors placed, sky behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.instances.shadows import name_splats
from instdrive_core.rasterize.kernels.settings import RasterSettings, choose_raster_settings
from instdrive_core.rasterize.kernels.sky_behind import render_sky_behind
from instdrive_core.rasterize.kernels.view_colors import compute_colors
from instdrive_core.rasterize.preview import DEFAULT_PICK_RULE, PickRule, Preview, render_preview
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene, place_in_world


def view_scene(
    scene: Scene,
    camera: Camera,
    time: float,
    drawn: Bool[ndarray, " n"] | None = None,
    settings: RasterSettings | None = None,
    rule: PickRule = DEFAULT_PICK_RULE,
) -> Preview:
    """Draw the scene as it is at `time` (seconds); its colour has the sky, or black, behind it.

    A photo's camera shows moving objects where the photo does (`Camera.lag`).
    No pixel stands for a splat of a shadow: what lies in the shadow is seen through it.

    Args:
        drawn: mask of the splats to draw, as `SplatState.drawn` gives it; all by default. Actors that do not exist
            at `time` are not drawn either.
        settings: those that the scene was trained for by default.
    """
    gaussians = scene.gaussians
    poses, present = scene.find_node_poses(time, camera.lag)
    means, quats = place_in_world(gaussians.means, gaussians.quats, scene.nodes, poses)
    colors = compute_colors(means, gaussians.sh_dc, gaussians.sh_rest, camera.position, scene.nodes, poses)
    opacities = gaussians.opacities
    if drawn is not None:
        opacities = np.where(drawn, opacities, np.float32(0))
    if not present.all():
        opacities = np.where(present[scene.nodes], opacities, np.float32(0))
    settings = settings or choose_raster_settings(scene)
    shapes, names = (means, quats, gaussians.log_scales, opacities), name_splats(scene.extra)
    frame = render_preview(*shapes, colors, camera, settings, rule, names, scene.instance_ids)
    return replace(frame, color=frame.color + render_sky_behind(scene.sky, camera, frame.alpha))


def build_instance_map(scene: Scene, frame: Preview) -> UInt32[ndarray, "h w"]:
    """Find the instance that each pixel stands for, 0 for none."""
    if not len(scene):
        return np.zeros(frame.winner.shape, np.uint32)
    return np.where(frame.winner >= 0, scene.instance_ids[frame.winner], 0).astype(np.uint32)
