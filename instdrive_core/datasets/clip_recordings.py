"""Recordings out of clips, so that a clip of any data set can be written in another one's layout."""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from PIL import Image

from instdrive_core.datasets.clip import Clip, Frame, Sweep
from instdrive_core.datasets.photos import load_photo, read_photo_size
from instdrive_core.datasets.recording import (
    Lens,
    RecordedPhoto,
    RecordedPoints,
    RecordedSweep,
    Recording,
    open_photo_file,
)
from instdrive_core.datasets.rig_files import CAR_FROM_OPENCV, invert_pose
from instdrive_core.errors import DataError
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.track import Track

START = 1000.0
"""Seconds at which a recording's clip starts: points measured just before its first step have positive times, too."""
EYE_HEIGHT = 1.6
"""Metres of the front camera over the recording car's frame."""


def record_clip(clip: Clip) -> Recording:
    """Take a clip that was opened at full size as a recording. Its photos are the files on disk where nothing was
    changed on reading, else PNGs of what was read.

    The recording car's frame lies below the first camera and looks as it does at the first step, levelled.
    """
    lenses = {name: _describe_lens(next(f for f in clip.frames if f.view.name == name)) for name in clip.camera_names}
    photos = tuple(_describe_photo(frame, clip.origin) for frame in clip.frames)
    step_times = {frame.view.index: frame.view.time + START for frame in clip.frames}
    ego = _place_car(photos, clip.camera_names[0], sorted(step_times))
    sweeps = tuple(
        RecordedSweep(sweep.index, sweep.time + START, ego[sweep.index], partial(_load_points, sweep, clip.origin))
        for sweep in clip.sweeps
        if sweep.index in ego
    )
    tracks = tuple(_shift_track(track, clip.origin) for track in clip.tracks)
    return Recording(Path(clip.path), clip.name, lenses, step_times, photos, sweeps, tracks, ego)


def _describe_lens(frame: Frame) -> Lens:
    camera = frame.view.camera
    pinhole = Camera(camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height, np.eye(4))
    shown = np.arange(camera.height) if frame.valid is None else np.flatnonzero(frame.valid.any(axis=1))
    return Lens(pinhole, hidden=1 - float(shown.max(initial=-1) + 1) / camera.height)


def _describe_photo(frame: Frame, origin: Float64[ndarray, "3"]) -> RecordedPhoto:
    pose = frame.view.camera.world_from_camera.copy()
    pose[:3, 3] += origin
    view, lag = frame.view, frame.view.camera.lag
    taken = START + view.time + (0.0 if lag is None else lag.taken)
    return RecordedPhoto(view.name, view.index, taken, pose, Path(view.photo), partial(_open_photo, frame))


def _open_photo(frame: Frame) -> io.BufferedIOBase:
    """Open the photo's own file where it shows what the frame does, else a PNG of the frame."""
    image, file = frame.load_image(), Path(frame.view.photo)
    size = frame.view.camera.width, frame.view.camera.height
    try:
        if read_photo_size(file) == size and np.array_equal(load_photo(file, size, size), image):
            return open_photo_file(file)()
    except DataError:  # the photo lies within another file
        pass
    packed = io.BytesIO()
    Image.fromarray(image).save(packed, "PNG")
    packed.seek(0)
    return packed


def _place_car(photos: tuple[RecordedPhoto, ...], camera: str, steps: list[int]) -> dict[int, ndarray]:
    """Pose of the car at each step, from the first camera's nearest photo."""
    poses = {photo.step: photo.world_from_camera for photo in photos if photo.camera == camera}
    first = poses[min(poses)]
    forward = first[:2, 2] / max(float(np.linalg.norm(first[:2, 2])), 1e-9)
    car = np.eye(4)
    car[:2, 0], car[:2, 1] = forward, (-forward[1], forward[0])
    car[:3, 3] = first[:3, 3] - (0, 0, EYE_HEIGHT)
    if abs(np.linalg.det(car[:3, :3]) - 1) > 1e-6:  # the first camera looks straight up or down
        car = first @ invert_pose(CAR_FROM_OPENCV)
    camera_from_car = invert_pose(first) @ car
    return {step: poses[min(poses, key=lambda known: abs(known - step))] @ camera_from_car for step in steps}


def _load_points(sweep: Sweep, origin: Float64[ndarray, "3"]) -> RecordedPoints:
    loaded = sweep.load()
    times = None if loaded.times is None else loaded.times + START
    return RecordedPoints(loaded.points.astype(np.float64) + origin, loaded.intensity, loaded.sensor, times)


def _shift_track(track: Track, origin: Float64[ndarray, "3"]) -> Track:
    poses = track.world_from_box.copy()
    poses[:, :3, 3] += origin
    return Track(track.id, track.label, track.dimensions, track.times + START, poses, track.moving)
