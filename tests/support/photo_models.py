"""Coloured blobs around the origin, rendered from a few cameras: what tests write as COLMAP and nerfstudio folders."""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.rasterize.render import render
from instdrive_core.scene.camera import Camera, look_at

COUNT = 5
WIDTH, HEIGHT, FOCAL = 64, 48, 50.0
SEEING = (1, 3, 5)
"""Images (from 1) whose only observation is the first point; the other points are seen by none."""
TILT = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
"""From z-up to the files' world, whose y points down as COLMAP's often does."""


@dataclass(frozen=True)
class PhotoModel:
    """A scene in a world with z up, its cameras and photos."""

    points: np.ndarray
    colors: np.ndarray
    cameras: tuple[Camera, ...]
    photos: tuple[np.ndarray, ...]

    @property
    def names(self) -> list[str]:
        """Names of the photos, in order."""
        return [f"{index:03d}.png" for index in range(COUNT)]

    def listed_points(self) -> np.ndarray:
        """Points as the files hold them."""
        return self.points @ TILT.T

    def listed_poses(self) -> list[np.ndarray]:
        """world_from_camera as the files hold them (OpenCV axes)."""
        poses = [camera.world_from_camera.copy() for camera in self.cameras]
        for pose in poses:
            pose[:3] = TILT @ pose[:3]
        return poses


def photo_model() -> PhotoModel:
    """40 blobs seen by 5 level cameras, 8 m away."""
    rng = np.random.default_rng(0)
    points, colors = rng.uniform(-2, 2, (40, 3)), rng.integers(0, 256, (40, 3)).astype(np.uint8)
    splats = (
        points,
        np.tile([1.0, 0, 0, 0], (len(points), 1)),
        np.full((len(points), 3), np.log(0.3)),
        np.full(len(points), 0.95),
        colors / 255,
    )
    angles = np.linspace(0, np.pi, COUNT)
    centers = [np.array([8 * np.cos(angle), 8 * np.sin(angle), 0.0]) for angle in angles]
    cameras = tuple(
        Camera(FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT, look_at(center, np.zeros(3))) for center in centers
    )
    photos = tuple(np.round(render(*splats, camera).image.clip(0, 1) * 255).astype(np.uint8) for camera in cameras)
    return PhotoModel(points, colors, cameras, photos)


def write_photos(folder: Path, model: PhotoModel) -> None:
    """The photos under their names."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, photo in zip(model.names, model.photos, strict=True):
        Image.fromarray(photo).save(folder / name)


def colmap_poses(model: PhotoModel) -> list[tuple[list[float], list[float]]]:
    """Quaternion (w first) and translation, camera from world."""
    inverses = [np.linalg.inv(pose) for pose in model.listed_poses()]
    return [(quaternion_from_matrix(pose[:3, :3]).tolist(), pose[:3, 3].tolist()) for pose in inverses]


def write_colmap_binary(root: Path, model: PhotoModel) -> Path:
    """A folder with ``images`` and ``sparse/0`` as COLMAP writes it."""
    write_photos(root / "images", model)
    folder = root / "sparse" / "0"
    folder.mkdir(parents=True)
    camera = struct.pack("<QIiQQ4d", 1, 7, 1, WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
    (folder / "cameras.bin").write_bytes(camera)
    images = struct.pack("<Q", COUNT)
    for number, (name, (quat, translation)) in enumerate(zip(model.names, colmap_poses(model), strict=True), 1):
        images += struct.pack("<I7dI", number, *quat, *translation, 7) + name.encode() + b"\0"
        images += struct.pack("<QddQ", 1, 3.5, 4.5, 1) if number in SEEING else struct.pack("<Q", 0)
    (folder / "images.bin").write_bytes(images)
    points = struct.pack("<Q", len(model.points))
    for number, (point, color) in enumerate(zip(model.listed_points(), model.colors.tolist(), strict=True), 1):
        track = [word for image in SEEING for word in (image, 0)] if number == 1 else []
        points += struct.pack(f"<Q3d3BdQ{len(track)}I", number, *point, *color, 0.5, len(track) // 2, *track)
    (folder / "points3D.bin").write_bytes(points)
    return root


def write_colmap_text(root: Path, model: PhotoModel) -> Path:
    """Write the model as COLMAP's text files."""
    write_photos(root / "images", model)
    folder = root / "sparse" / "0"
    folder.mkdir(parents=True)
    (folder / "cameras.txt").write_text(
        f"# Number of cameras: 1\n7 PINHOLE {WIDTH} {HEIGHT} {FOCAL} {FOCAL} {WIDTH / 2} {HEIGHT / 2}\n"
    )
    lines = [f"# Number of images: {COUNT}, mean observations per image: 0"]
    for number, (name, (quat, translation)) in enumerate(zip(model.names, colmap_poses(model), strict=True), 1):
        lines += [
            " ".join(map(repr, [number, *quat, *translation, 7])) + f" {name}",
            "3.5 4.5 1" if number in SEEING else "",
        ]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    lines = [f"# Number of points: {len(model.points)}, mean track length: 1"]
    for number, (point, color) in enumerate(zip(model.listed_points(), model.colors.tolist(), strict=True), 1):
        track = [word for image in SEEING for word in (image, 0)] if number == 1 else []
        lines.append(" ".join(map(repr, [number, *point.tolist(), *color, 0.5, *track])))
    (folder / "points3D.txt").write_text("\n".join(lines) + "\n")
    return root


def write_nerfstudio(root: Path, model: PhotoModel, form: str = "binary_little_endian") -> Path:
    """A folder with ``transforms.json``, ``images`` and ``points.ply`` in a form."""
    write_photos(root / "images", model)
    frames = [
        {"file_path": f"images/{name}", "transform_matrix": (pose @ np.diag([1.0, -1, -1, 1])).tolist()}
        for name, pose in zip(model.names, model.listed_poses(), strict=True)
    ]
    size = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    content = {"camera_model": "OPENCV", **size, "ply_file_path": "points.ply", "frames": frames}
    (root / "transforms.json").write_text(json.dumps(content))
    columns = [("float", name) for name in "xyz"] + [("uchar", name) for name in ("red", "green", "blue")]
    header = ["ply", f"format {form} 1.0", f"element vertex {len(model.points)}"]
    header += [f"property {kind} {name}" for kind, name in columns] + ["end_header", ""]
    rows = zip(model.listed_points(), model.colors.tolist(), strict=True)
    if form == "ascii":
        body = "".join(" ".join(map(repr, [*point.tolist(), *color])) + "\n" for point, color in rows).encode()
    else:
        order = "<" if form == "binary_little_endian" else ">"
        body = b"".join(struct.pack(order + "3f3B", *point, *color) for point, color in rows)
    (root / "points.ply").write_bytes("\n".join(header).encode() + body)
    return root
