"""Photos of a textured street through which a camera drives, and of textured boards that stand or move in it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

from instdrive_core.datasets.clip import Clip, Frame, SparsePoints, is_held_out
from instdrive_core.masks.label_map_folder import FrameMasks, MaskFolder, write_masks
from instdrive_core.scene.camera import Camera, CameraView, look_at

WIDTH, HEIGHT, FOCAL = 240, 140, 200.0
CAMERA = "front"
RIDES = 1.5
"""Metres of the camera above the ground."""
STEP = 0.1
"""Seconds between photos."""
GROUND, WALLS, FIRST_BOARD = 1, 2, 3


@dataclass(frozen=True)
class Board:
    """An upright board across the street whose lower edge is on the ground."""

    at: Callable[[float], tuple[float, float]]
    """Its middle, x to the right and y ahead (metres), at a time (seconds)."""
    width: float = 2.0
    height: float = 1.4


def standing_board(x: float, y: float) -> Board:
    """A board that stays where it is."""
    return Board(lambda time: (x, y))


def make_clip(boards: Sequence[Board], count: int = 14, speed: float = 8.0, path: str = "street") -> Clip:
    """A clip of one camera that drives straight ahead, without LiDAR."""
    frames = []
    for index in range(count):
        time = STEP * index
        position = np.array([0.0, speed * time, RIDES])
        camera = Camera(
            FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT, look_at(position, position + np.array([0, 10, -0.4]))
        )
        view = CameraView(camera, CAMERA, index, time, f"{CAMERA}/{index:03d}.png", is_held_out(index))
        frames.append(Frame(view, lambda camera=camera, time=time: paint(camera, time, boards)[0]))
    empty = np.zeros(3)
    return Clip(path, "street", empty, tuple(frames), (), (), {}, (CAMERA,), SparsePoints.none())


def write_street_masks(folder: Path, clip: Clip, boards: Sequence[Board]) -> MaskFolder:
    """Exact masks of the training photos: ground, walls, each board."""
    masks = (
        (frame.key, FrameMasks(labels, labels == 0))
        for frame in clip.training_frames
        for labels in [paint(frame.view.camera, frame.view.time, boards)[1]]
    )
    return write_masks(folder, masks, "exact", 0)


def write_as_nerfstudio(root: Path, boards: Sequence[Board], count: int = 14) -> Path:
    """The street as a nerfstudio folder with its masks."""
    clip, entries = make_clip(boards, count), []
    for frame in clip.frames:
        file = root / "images" / f"{frame.view.index:03d}.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(frame.load_image()).save(file)
        pose = frame.view.camera.world_from_camera @ np.diag([1.0, -1, -1, 1])
        entries.append({"file_path": f"images/{file.name}", "transform_matrix": pose.tolist()})
    intrinsics = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2, "w": WIDTH, "h": HEIGHT}
    (root / "transforms.json").write_text(json.dumps({"camera_model": "PINHOLE", **intrinsics, "frames": entries}))
    return root


def paint(camera: Camera, time: float, boards: Sequence[Board]) -> tuple[np.ndarray, np.ndarray]:
    """Photo and label map: textures are fixed to what they are on."""
    photo, labels, _ = paint_with_depth(camera, time, boards)
    return photo, labels


def paint_with_depth(camera: Camera, time: float, boards: Sequence[Board]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Photo, label map, and depths along the optical axis, infinite in the sky."""
    rays = camera.compute_ray_directions().reshape(-1, 3)
    origin = camera.position
    grey, labels = np.full(len(rays), 200.0), np.zeros(len(rays), np.uint16)
    nearest = np.full(len(rays), np.inf)

    def put(distance: np.ndarray, inside: np.ndarray, u: np.ndarray, v: np.ndarray, label: int) -> None:
        hit = inside & (distance > 0.1) & (distance < nearest)
        nearest[hit], labels[hit] = distance[hit], label
        grey[hit] = read_texture(label, u[hit], v[hit])

    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -origin[2] / rays[:, 2]
        x, y = (origin[axis] + distance * rays[:, axis] for axis in (0, 1))
        put(distance, np.abs(x) < 6, x, y, GROUND)
        for side in (-6.0, 6.0):
            distance = (side - origin[0]) / rays[:, 0]
            y, z = (origin[axis] + distance * rays[:, axis] for axis in (1, 2))
            put(distance, (z > 0) & (z < 5) & (y < 70), y, z, WALLS)
        distance = (70 - origin[1]) / rays[:, 1]
        x, z = (origin[axis] + distance * rays[:, axis] for axis in (0, 2))
        put(distance, (z > 0) & (z < 5) & (np.abs(x) < 6), x, z, WALLS)
        for number, board in enumerate(boards):
            middle, ahead = board.at(time)
            distance = (ahead - origin[1]) / rays[:, 1]
            x, z = (origin[axis] + distance * rays[:, axis] for axis in (0, 2))
            inside = (np.abs(x - middle) < board.width / 2) & (z > 0) & (z < board.height)
            put(distance, inside, x - middle, z, FIRST_BOARD + number)
    shape = camera.height, camera.width
    photo = np.repeat(grey.reshape(*shape, 1), 3, axis=2)
    depths = nearest * (rays @ camera.world_from_camera[:3, 2])
    return photo.astype(np.uint8), labels.reshape(shape), depths.reshape(shape)


def read_texture(label: int, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Grey values of a smooth random texture with details of some 0.1 and 0.4 m."""
    rng = np.random.default_rng(label)
    values = np.zeros(len(u))
    for cell, strength in ((0.08, 35.0), (0.35, 45.0)):
        noise = gaussian_filter(rng.normal(size=(256, 256)), 1.0, mode="wrap")
        values += strength / noise.std() * map_coordinates(noise, [u / cell, v / cell], order=1, mode="grid-wrap")
    return np.clip(120 + values, 0, 255)
