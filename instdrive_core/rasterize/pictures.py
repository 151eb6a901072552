"""Pictures of a preview to look at: colour, instances, codewords or depth."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray

from instdrive_core.instances.colormap import ID_LIMIT, colors_from_ids
from instdrive_core.maths.activations import logit
from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.settings import choose_raster_settings
from instdrive_core.rasterize.kernels.view_colors import compute_colors
from instdrive_core.rasterize.preview import DEFAULT_PICK_RULE, Preview, blend_projected
from instdrive_core.rasterize.preview.colors import know_colors
from instdrive_core.rasterize.preview.projection import project_splats
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.rasterize.splat_looks import (
    DOT_LOG_SCALE,
    DOT_OPACITY,
    DOT_SETTINGS,
    RING_RULE,
    make_dots,
    paint_rings,
)
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene, place_in_world

Mode = Literal["color", "instance", "codeword", "depth"]
Look = Mode | Literal["centers", "rings"]
"""What a picture shows: a mode of a preview, or the splats themselves."""
_RAMP = np.array(
    [[48, 18, 59], [66, 120, 240], [27, 208, 213], [114, 250, 92], [237, 208, 58], [251, 114, 27], [122, 4, 3]]
)
"""Colours from near to far, evenly spaced in the logarithm of depth."""


def colorize_preview(scene: Scene, shown: Preview, mode: Mode) -> UInt8[ndarray, "h w 3"]:
    """Draw the pixels of one mode; IDs in exact colours, depth as a ramp over the logarithm of the depths present."""
    match mode:
        case "color":
            return np.round(np.clip(shown.color, 0, 1) * 255).astype(np.uint8)
        case "instance":
            return colors_from_ids(build_instance_map(scene, shown))
        case "codeword":
            # As in the editor: the colour map holds 24 bits, a longer codeword shows its low ones.
            codewords = np.zeros(shown.winner.shape, np.uint32)
            codewords[shown.winner >= 0] = scene.codewords[shown.winner[shown.winner >= 0]]
            return colors_from_ids(codewords & np.uint32(ID_LIMIT - 1))
        case "depth":
            return colorize_depth(shown.depth, shown.alpha >= 0.5)


def cut_out_preview(scene: Scene, shown: Preview, mode: Mode) -> UInt8[ndarray, "h w 4"]:
    """Draw the pixels of one mode as RGBA: see-through where no splat is. Draw `shown` without a sky.

    Colours are not premultiplied. Pixels of other modes than colour are there or not.
    """
    if mode == "color":
        alpha = np.clip(shown.alpha, 0, 1)[..., None]
        color = np.clip(shown.color / np.maximum(alpha, 1e-6), 0, 1)
        return np.round(np.concatenate([color, alpha], axis=-1) * 255).astype(np.uint8)
    picture = colorize_preview(scene, shown, mode)
    there = picture.any(axis=-1, keepdims=True)
    return np.concatenate([picture, np.where(there, 255, 0).astype(np.uint8)], axis=-1)


def draw_picture(
    scene: Scene, camera: Camera, time: float, look: Look, transparent: bool = False
) -> UInt8[ndarray, "h w channels"]:
    """Draw the scene as it is at `time` (seconds): RGB, or RGBA without the sky where it is `transparent`."""
    if transparent or look in ("centers", "rings"):
        scene = replace(scene, sky=None)
    if look == "rings":
        picture, there = _draw_rings(scene, camera, time)
        return np.concatenate([picture, there], axis=-1) if transparent else picture
    if look == "centers":
        gaussians = scene.gaussians
        solid = make_dots(gaussians.opacities, DEFAULT_PICK_RULE.min_opacity) > 0
        points = np.full_like(gaussians.log_scales, DOT_LOG_SCALE)
        logits = np.where(solid, logit(np.array([DOT_OPACITY])), -30.0).astype(np.float32)
        scene = replace(scene, gaussians=replace(gaussians, log_scales=points, opacity_logits=logits))
    shown = view_scene(scene, camera, time, settings=DOT_SETTINGS if look == "centers" else None)
    mode: Mode = "color" if look == "centers" else look
    return (cut_out_preview if transparent else colorize_preview)(scene, shown, mode)


def _draw_rings(scene: Scene, camera: Camera, time: float) -> tuple[UInt8[ndarray, "h w 3"], UInt8[ndarray, "h w 1"]]:
    """Draw splats as ellipses with rims; also, from 0 to 255, where there are any."""
    gaussians, settings = scene.gaussians, choose_raster_settings(scene)
    poses, present = scene.find_node_poses(time, camera.lag)
    means, quats = place_in_world(gaussians.means, gaussians.quats, scene.nodes, poses)
    opacities = np.where(present[scene.nodes], gaussians.opacities, np.float32(0))
    means, quats, opacities = (to_kernel_array(array) for array in (means, quats, opacities))
    log_scales = to_kernel_array(gaussians.log_scales)
    colors = compute_colors(means, gaussians.sh_dc, gaussians.sh_rest, camera.position, scene.nodes, poses)
    source = know_colors(colors)
    workspace = Workspace()
    found = project_splats(means, quats, log_scales, opacities, camera, settings, source, workspace)
    winner = blend_projected(found, camera, workspace, settings, RING_RULE).winner
    picture = paint_rings(found, winner, RING_RULE.min_alpha)
    there = np.where(winner >= 0, 255, 0).astype(np.uint8)[..., None]
    return np.round(np.clip(picture, 0, 1) * 255).astype(np.uint8), there


def colorize_depth(
    depth: Float[ndarray, "h w"], there: Bool[ndarray, "h w"], ramp: tuple[float, float] | None = None
) -> UInt8[ndarray, "h w 3"]:
    """Draw depth in colours: near violet, far red, nothing black.

    `ramp` gives the depths (metres) of both ends; by default it spans 1 % to 99 % of the depths present.
    """
    colors = np.zeros((*depth.shape, 3), np.uint8)
    ramp = ramp or measure_depth_range(depth, there)
    if ramp is not None:
        near, far = np.log(ramp)
        logs = np.log(np.maximum(depth[there], 1e-6))
        places = np.clip((logs - near) / max(far - near, 1e-6), 0, 1) * (len(_RAMP) - 1)
        channels = [np.interp(places, np.arange(len(_RAMP)), _RAMP[:, channel]) for channel in range(3)]
        colors[there] = np.round(np.stack(channels, axis=-1))
    return colors


def measure_depth_range(depth: Float[ndarray, "h w"], there: Bool[ndarray, "h w"]) -> tuple[float, float] | None:
    """Measure the depths (metres) between which 98 % of those present lie; None where there are none."""
    if not there.any():
        return None
    near, far = np.exp(np.quantile(np.log(np.maximum(depth[there], 1e-6)), [0.01, 0.99])).tolist()
    return near, far
