"""Which key of a way, or which place of the ground, is under the mouse in the view."""

from __future__ import annotations

import numpy as np

from instdrive_app.session.driving.path_editor import PathEditor
from instdrive_core.scene.camera import Camera

KEY_PIXELS, WAY_PIXELS = 11.0, 8.0
"""Pixels at scale 1 around a key, and around the way, where the mouse finds them."""
FARTHEST = 500.0
"""Metres from the camera up to which a place on the ground is meant."""
_NEAREST = 0.1


def find_key_at(editor: PathEditor, camera: Camera, x: float, y: float, pixel_scale: float = 1.0) -> int | None:
    """Find the key that `camera` shows at a pixel; the nearest one, None where none is near.

    Args:
        pixel_scale: Pixels of the picture for one at scale 1.
    """
    places = editor.find_places() if editor.keys else np.zeros((0, 3))
    if not len(places):
        return None
    pixels, depths = camera.project(places)
    apart = np.where(depths > _NEAREST, np.hypot(pixels[:, 0] - x, pixels[:, 1] - y), np.inf)
    nearest = int(np.argmin(apart))
    return nearest if apart[nearest] <= KEY_PIXELS * pixel_scale else None


def measure_to_way(editor: PathEditor, camera: Camera, x: float, y: float) -> float:
    """Measure from a pixel to the line of the way, in pixels; infinite where there is none."""
    line = editor.find_line()
    if len(line) < 2:
        return float("inf")
    pixels, depths = camera.project(line)
    start, end = pixels[:-1], pixels[1:]
    along = end - start
    share = ((np.array([x, y]) - start) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-9)
    nearest = start + np.clip(share, 0, 1)[:, None] * along
    apart = np.hypot(nearest[:, 0] - x, nearest[:, 1] - y)
    is_seen = (depths[:-1] > _NEAREST) & (depths[1:] > _NEAREST)
    return float(apart[is_seen].min()) if is_seen.any() else float("inf")


def find_on_ground(camera: Camera, height: float, x: float, y: float) -> tuple[float, float] | None:
    """Find the place (metres) where the ray through a pixel meets level ground of a height; None where it does not."""
    ray = camera.world_from_camera[:3, :3] @ np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0])
    ray /= np.linalg.norm(ray)
    drop = height - camera.position[2]
    if abs(ray[2]) < 1e-6 or not 0 < drop / ray[2] < FARTHEST:
        return None
    place = camera.position + drop / ray[2] * ray
    return float(place[0]), float(place[1])
