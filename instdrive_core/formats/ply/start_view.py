"""The view and the sky that travel with an exported .ply: a header comment, and a picture of the sky beside the file.

The comment holds the camera from which the user looked, the axis that is up, and the name of the picture. Programs that
do not know it pass over it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from instdrive_core.files.atomic import open_atomically
from instdrive_core.files.json_value import parse_json
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky

VIEW = "instdrive view "
SKY_ENDING = ".sky.png"
"""Ending of the picture: six square faces, one below the other, in the order of `Sky.faces`."""
MAX_RESOLUTION = 2048
"""Pixels per side of a face; larger pictures are passed over."""
_NUMBERS = ("fx", "fy", "cx", "cy")


def build_view_comments(scene: Scene, path: Path) -> list[str]:
    """Build the comment line of a scene with a start view; none for other scenes."""
    if scene.start is None:
        return []
    entry: dict[str, Any] = {name: float(getattr(scene.start, name)) for name in _NUMBERS}
    entry |= {"width": int(scene.start.width), "height": int(scene.start.height)}
    entry |= {"world_from_camera": scene.start.world_from_camera.tolist(), "up": "+z"}
    if scene.sky is not None:
        entry["sky"] = find_sky_path(path).name
    return [VIEW + json.dumps(entry, ensure_ascii=True, separators=(",", ":"))]


def parse_view_comment(comment: str) -> Camera:
    """Read the camera of a comment. Raises ValueError, KeyError or TypeError where it is damaged."""
    entry = parse_json(comment.removeprefix(VIEW))
    pose = np.array(entry["world_from_camera"], np.float64)
    fx, fy, cx, cy = (float(entry[name]) for name in _NUMBERS)
    width, height = int(entry["width"]), int(entry["height"])
    turn = pose[:3, :3]
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or not np.isfinite([fx, fy, cx, cy]).all():
        raise ValueError("the camera holds numbers that are not finite")
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or min(fx, fy, width, height) <= 0:
        raise ValueError("the camera is none")
    return Camera(fx, fy, cx, cy, width, height, pose)


def find_sky_path(path: Path) -> Path:
    """Find where the picture of the sky stands that belongs to a .ply."""
    return path.with_name(path.name + SKY_ENDING)


def write_sky_picture(path: Path, sky: Sky) -> None:
    """Write the picture of the sky beside the .ply at `path`, with 8 bits per channel."""
    faces = (sky.faces.clip(0, 1) * 255).round().astype(np.uint8)
    with open_atomically(find_sky_path(path)) as file:
        Image.fromarray(faces.reshape(-1, faces.shape[1], 3)).save(file, format="PNG")


def read_sky_picture(path: Path) -> Sky | None:
    """Read the sky beside the .ply at `path`; None where there is no such picture, or it is not of a sky."""
    try:
        with Image.open(find_sky_path(path)) as picture:
            width, height = picture.size
            if height != 6 * width or not 0 < width <= MAX_RESOLUTION or picture.format != "PNG":
                return None
            pixels = np.asarray(picture.convert("RGB"), np.float32) / 255
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    return Sky(pixels.reshape(6, width, width, 3))
