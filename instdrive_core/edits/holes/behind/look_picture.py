"""What a photo would show now that a thing is gone: drawn finely, judged in coarse pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from numpy import ndarray

from instdrive_core.edits.queries.compact_objects import is_compact, is_tall
from instdrive_core.rasterize.kernels.settings import choose_raster_settings
from instdrive_core.rasterize.kernels.sky_behind import render_sky_behind
from instdrive_core.rasterize.kernels.view_colors import compute_colors
from instdrive_core.rasterize.preview import render_preview
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.scene import Scene, place_in_world

COARSE, FINE = 2, 2
FACTOR = COARSE * FINE
"""Pieces are chosen in pictures so many times smaller than a look, and copied in ones so many times larger."""
SKY_ALPHA = 0.5
"""Pixels that splats cover less show the sky: where they are copied, nothing stands."""


@dataclass(frozen=True)
class Remains:
    """What is left around a thing that is gone."""

    scene: Scene
    seen: Bool[ndarray, " n"]
    """Its splats that photos reached past the thing."""
    hiding: Float64[ndarray, "k 3"]
    """Points of what else is gone and hid things: where it stood, noise shows. Metres."""


@dataclass(frozen=True)
class LookPicture:
    """A look in fine pixels."""

    camera: Camera
    color: Float[ndarray, "h w 3"]
    """Colour of what covers a pixel, as if it stopped all light; of the sky where it stops less than half."""
    alpha: Float[ndarray, "h w"]
    depth: Float[ndarray, "h w"]
    """Metres along the viewing axis."""
    things: Float32[ndarray, "h w"]
    """1 where something compact shows, such as a car, else 0."""
    told: Float32[ndarray, "h w"]
    """1 where photos told what shows there, though the thing stood before it."""


def fit_camera(camera: Camera) -> Camera:
    """The camera of a look at the fine size: whole coarse pixels, the rest cut off."""
    fine, factor = camera.scale(FINE), FACTOR
    return replace(fine, width=max(fine.width // factor, 1) * factor, height=max(fine.height // factor, 1) * factor)


def shrink(picture: Float[ndarray, "h w *c"]) -> Float64[ndarray, "a b *c"]:
    """Mean over the fine pixels of each coarse one."""
    factor = FACTOR
    height, width = picture.shape[0] // factor, picture.shape[1] // factor
    blocks = picture.reshape(height, factor, width, factor, *picture.shape[2:])
    return np.asarray(blocks.mean(axis=(1, 3)), np.float64)


def draw_look(remains: Remains, fills: list[Gaussians], camera: Camera, time: float) -> LookPicture:
    """Draw what remains, with what fills it, as `camera` would have seen it at `time` (seconds)."""
    scene = remains.scene
    poses, present = scene.find_node_poses(time, camera.lag)
    added = concatenate_gaussians(fills)
    placed = place_in_world(scene.gaussians.means, scene.gaussians.quats, scene.nodes, poses)
    means, quats = (np.concatenate(parts) for parts in zip(placed, (added.means, added.quats), strict=True))
    sizes, sh_dc, sh_rest = (
        np.concatenate([getattr(part, name) for part in (scene.gaussians, added)])
        for name in ("log_scales", "sh_dc", "sh_rest")
    )
    nodes = np.concatenate([scene.nodes, np.zeros(len(added), scene.nodes.dtype)])
    colors = compute_colors(means, sh_dc, sh_rest, camera.position, nodes, poses)
    opacities = np.where(present[scene.nodes], scene.gaussians.opacities, np.float32(0))
    opacities = np.concatenate([opacities, added.opacities])
    instances = np.concatenate([scene.instance_ids, np.zeros(len(added), np.uint32)])
    settings = choose_raster_settings(scene)
    frame = render_preview(means, quats, sizes, opacities, colors, camera, settings, instances=instances)
    alpha = frame.alpha[..., None]
    over_sky = frame.color + render_sky_behind(scene.sky, camera, frame.alpha)
    # A copy stops all light: of the sky that shines through what is copied, it must have nothing.
    color = np.where(alpha >= SKY_ALPHA, frame.color / np.maximum(alpha, SKY_ALPHA), over_sky)
    compact = [instance.id for instance in scene.table if is_compact(instance) and not is_tall(instance)]
    shown = (frame.winner >= 0) & (frame.winner < len(scene))
    rows = np.where(shown, frame.winner, 0)
    things, told = shown & np.isin(scene.instance_ids[rows], compact), shown & remains.seen[rows]
    return LookPicture(camera, color, frame.alpha, frame.depth, things.astype(np.float32), told.astype(np.float32))
