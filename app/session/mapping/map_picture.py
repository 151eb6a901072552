"""The map's picture: what stands still, seen from straight above, without what hangs over the street."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, UInt8, UInt32
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_app.session.mapping.map_window import MapWindow
from instdrive_core.edits.document.document import Document
from instdrive_core.rasterize.pictures import cut_out_preview
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.palette import bake_colors
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import bake_transforms

FAINTEST_LOGIT = -2.0
"""Fainter splats are left out."""
CEILING = 2.0
"""Metres above the nearest camera from which nothing is drawn: crowns, roofs and what floats would hide the street."""
LOWEST_SHARE = 0.2
"""Share of the splats below the level that is shown without enlargement."""
FAR = 40.0
"""The camera's height over that level, relative to the larger side of what it shows and to the heights of the scene:
things hardly lean outwards then."""


@dataclass(frozen=True)
class MapPicture:
    """A window of the ground, drawn."""

    window: MapWindow
    rgba: UInt8[ndarray, "h w 4"]
    """See-through where no splat is."""
    ids: UInt32[ndarray, "h w"]
    """Instance of each pixel, 0 for none."""


def extract_ground(document: Document) -> Scene:
    """Extract what a map shows of a document: splats of the background that are drawn and not above the ceiling."""
    scene = document.scene
    shown = document.state.drawn.astype(bool) & (scene.nodes == 0) & (scene.gaussians.opacity_logits > FAINTEST_LOGIT)
    rows = np.flatnonzero(shown)
    means = document.compute_means(rows)
    rows = rows[np.isfinite(means).all(axis=1)]
    rows = rows[~find_overhead(document.compute_means(rows), scene.views)]
    own = scene.gaussians
    count = len(rows)
    gaussians = Gaussians(
        own.means[rows],
        own.quats[rows],
        own.log_scales[rows],
        own.opacity_logits[rows],
        own.sh_dc[rows],
        np.zeros((count, 0, 3), np.float32),
        np.zeros((count, 0), np.float32),
    )
    entries = document.colors.indices[rows]
    if entries.any():
        changed = np.flatnonzero(entries)
        dc, _, logits = bake_colors(own, document.colors, rows[changed])
        gaussians.sh_dc[changed], gaussians.opacity_logits[changed] = dc, logits
    bake_transforms(gaussians, document.transforms, document.transforms.indices[rows])
    zeros = np.zeros(count, np.uint32)
    return Scene(gaussians, scene.instance_ids[rows], zeros, np.zeros(count, np.uint16), antialiased=scene.antialiased)


def find_overhead(means: Float32[ndarray, "n 3"], views: tuple[CameraView, ...]) -> Bool[ndarray, " n"]:
    """Find the splats that are higher than `CEILING` metres above the camera nearest to them; none without cameras."""
    if not views or not len(means):
        return np.zeros(len(means), bool)
    cameras = np.stack([view.camera.position for view in views])
    nearest = KDTree(cameras[:, :2]).query(means[:, :2], workers=1)[1]
    return means[:, 2] > cameras[nearest, 2] + CEILING


def draw_map(ground: Scene, window: MapWindow) -> MapPicture:
    """Draw a window of what `extract_ground` has found."""
    shape = (window.height, window.width)
    if not len(ground):
        return MapPicture(window, np.zeros((*shape, 4), np.uint8), np.zeros(shape, np.uint32))
    frame = view_scene(ground, build_map_camera(window, ground.gaussians.means[:, 2]), 0.0)
    return MapPicture(window, cut_out_preview(ground, frame, "color"), build_instance_map(ground, frame))


def build_map_camera(window: MapWindow, heights: Float32[ndarray, " n"]) -> Camera:
    """Build a camera straight above the middle of a window, so high that it shows `heights` (metres) nearly upright."""
    level, top = np.quantile(heights, [LOWEST_SHARE, 1.0]).tolist()
    side = max(window.width, window.height) * window.scale
    far = FAR * max(side, top - level)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = window.x, window.y, level + far
    focal = far / window.scale
    return Camera(focal, focal, window.width / 2, window.height / 2, window.width, window.height, pose)


def mark_instances(picture: MapPicture, ids: tuple[int, ...], color: tuple[int, int, int]) -> UInt8[ndarray, "h w 4"]:
    """Return the picture with the instances `ids` tinted, and a line of this colour (RGB) around them."""
    inside = np.isin(picture.ids, np.array(ids, np.uint32))
    if not inside.any():
        return picture.rgba
    marked, grown = picture.rgba.copy(), inside.copy()
    grown[1:] |= inside[:-1]
    grown[:-1] |= inside[1:]
    grown[:, 1:] |= inside[:, :-1]
    grown[:, :-1] |= inside[:, 1:]
    tint = np.array(color, np.float32)
    marked[inside, :3] = np.round(0.7 * marked[inside, :3] + 0.3 * tint).astype(np.uint8)
    marked[grown & ~inside] = (*color, 255)
    return marked


def rescale_window(window: MapWindow, share: float) -> MapWindow:
    """Return a window that shows the same part of the ground with `share` times as many pixels along each side."""
    width, height = max(1, round(window.width * share)), max(1, round(window.height * share))
    return replace(window, scale=window.scale * window.width / width, width=width, height=height)
