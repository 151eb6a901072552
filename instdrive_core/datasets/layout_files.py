"""What writers of layouts share: new folders, photos in the form that a layout wants, boxes by time step."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from PIL import Image

from instdrive_core.datasets.recording import RecordedPhoto, Recording
from instdrive_core.datasets.rig_files import invert_pose
from instdrive_core.errors import DataError
from instdrive_core.scene.track import Track

SAME_STEP = 0.02
"""Seconds within which a box belongs to a time step."""
_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG"
_QUALITY = 95


def require_new_folder(folder: Path) -> None:
    """Make a folder. Raises DataError where it holds something already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise DataError(folder, "is not an empty folder", "Choose another one or delete it")
    folder.mkdir(parents=True, exist_ok=True)


def write_layout_file(file: Path, content: bytes) -> None:
    """Write a file and the folders above it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)


def write_json_file(file: Path, content: object) -> None:
    """Write JSON and the folders above the file."""
    write_layout_file(file, json.dumps(content).encode())


def write_matrix(file: Path, values: Float64[ndarray, "..."]) -> None:
    """Write numbers as text that reads back as the same numbers, a row a line."""
    rows = np.atleast_2d(values)
    write_layout_file(file, ("\n".join(" ".join(map(repr, row)) for row in rows.tolist()) + "\n").encode())


def encode_jpeg(photo: RecordedPhoto) -> bytes:
    """Encode a photo as JPEG: the same bytes where it is one already."""
    content = photo.read()
    return content if content.startswith(_JPEG) else _encode(content, "JPEG")


def encode_png(photo: RecordedPhoto) -> bytes:
    """Encode a photo as PNG: the same bytes where it is one already, else the same pixels."""
    content = photo.read()
    return content if content.startswith(_PNG) else _encode(content, "PNG")


def _encode(content: bytes, form: str) -> bytes:
    packed = io.BytesIO()
    with Image.open(io.BytesIO(content)) as image:
        options = {"quality": _QUALITY, "subsampling": 0} if form == "JPEG" else {"compress_level": 1}
        image.convert("RGB").save(packed, form, **options)
    return packed.getvalue()


def number_steps(recording: Recording) -> dict[int, int]:
    """Number a recording's steps from 0, without gaps: layouts have no other ones."""
    return {step: number for number, step in enumerate(sorted(recording.step_times))}


def place_cameras(recording: Recording) -> dict[str, Float64[ndarray, "4 4"]]:
    """Place each camera on the car, ego from camera, as it stood at its first photo."""
    placed: dict[str, ndarray] = {}
    for photo in sorted(recording.photos, key=lambda photo: photo.step):
        if photo.camera not in placed:
            placed[photo.camera] = invert_pose(recording.world_from_ego[photo.step]) @ photo.world_from_camera
    return placed


def list_boxes(recording: Recording) -> dict[int, list[tuple[int, Track, Float64[ndarray, "4 4"]]]]:
    """List the boxes of each step: the track's place in the recording, the track, and world from box."""
    boxes: dict[int, list[tuple[int, Track, ndarray]]] = {step: [] for step in recording.step_times}
    for place, track in enumerate(recording.tracks):
        for step, time in recording.step_times.items():
            nearest = int(np.argmin(np.abs(track.times - time)))
            if abs(track.times[nearest] - time) < SAME_STEP:
                boxes[step].append((place, track, track.world_from_box[nearest]))
    return boxes


def find_level_heading(
    frame: Float64[ndarray, "3 3"], forward: Float64[ndarray, "3"], axes: tuple[int, int]
) -> Float64[ndarray, "2"]:
    """Find the unit direction along two of a frame's axes that points, seen from above, where `forward` points.

    Args:
        frame: world from frame.
        forward: in the world, z up.
        axes: the two axes that a layout turns its boxes between.
    """
    sideways = np.cross([0, 0, 1.0], forward)
    first, second = (frame.T @ sideways)[list(axes)]
    heading = np.array([second, -first]) / max(float(np.hypot(first, second)), 1e-12)
    full = np.zeros(3)
    full[list(axes)] = heading
    return heading if (frame @ full) @ forward > 0 else -heading
