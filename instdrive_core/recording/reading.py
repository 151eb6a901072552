"""A finished recording read back as a clip, so that every layout and reader of clips takes it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame, SparsePoints, Sweep, SweepPoints
from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.recording.folder import MANIFEST, read_color, read_manifest
from instdrive_core.recording.sweep_files import list_sweep_files, read_moment_sweep
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.track import Track

_REMEDY = "Record the drive again"


def read_recorded_clip(folder: Path) -> Clip:
    """Read a finished recording as a clip: its pictures as photos, its boxes as tracks, named by the instances' IDs.

    Pictures and sweeps are read when asked for. Raises DataError where the recording is unfinished or damaged.
    """
    manifest = read_manifest(folder)
    try:
        origin = np.array(manifest["origin"], float)
        frames = tuple(_build_frame(folder, entry) for entry in manifest["views"])
        moments = [read_json(folder / entry["file"]) for entry in manifest["moments"]]
        tracks = _build_tracks(moments)
        times = {entry["step"]: entry["time"] for entry in manifest["moments"]}
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(folder / MANIFEST, f"is damaged ({type(error).__name__}: {error})", _REMEDY) from error
    found = list_sweep_files(folder, list(times))
    sweeps = tuple(Sweep(step, times[step], partial(_load_sweep, path)) for step, path in found.items())
    return Clip(
        path=str(folder),
        name=folder.resolve().name,
        origin=origin,
        frames=frames,
        sweeps=sweeps,
        tracks=tracks,
        class_names={},
        camera_names=tuple(manifest["cameras"]),
        points=None if sweeps else SparsePoints.none(),
    )


def _build_frame(folder: Path, entry: dict[str, Any]) -> Frame:
    pose = np.array(entry["world_from_camera"], float)
    if pose.shape != (4, 4):
        raise ValueError(f"a camera's pose has shape {pose.shape}")
    lens = entry["intrinsics"]
    camera = Camera(lens["fx"], lens["fy"], lens["cx"], lens["cy"], entry["width"], entry["height"], pose)
    path = folder / entry["color"]
    view = CameraView(camera, entry["camera"], entry["step"], entry["time"], str(path), entry["held_out"])
    return Frame(view, partial(read_color, path))


def _build_tracks(moments: list[dict[str, Any]]) -> tuple[Track, ...]:
    """A track per instance that has a box, with the moments at which it is there."""
    found: dict[int, list[tuple[float, dict[str, Any]]]] = {}
    for moment in moments:
        for box in moment["boxes"]:
            found.setdefault(box["id"], []).append((moment["time"], box))
    return tuple(_build_track(instance_id, boxes) for instance_id, boxes in sorted(found.items()))


def _build_track(instance_id: int, boxes: list[tuple[float, dict[str, Any]]]) -> Track:
    first = boxes[0][1]
    size = np.array([first["size"][name] for name in ("width", "length", "height")], float)
    poses = np.stack([_build_pose(box) for _, box in boxes])
    times = np.array([time for time, _ in boxes], float)
    return Track(str(instance_id), first["class"] or first["name"], size, times, poses, bool(first["moving"]))


def _build_pose(box: dict[str, Any]) -> Float64[ndarray, "4 4"]:
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_quaternion(np.array(box["rotation"], float))
    pose[:3, 3] = box["center"]
    return pose


def _load_sweep(path: Path) -> SweepPoints:
    sweep = read_moment_sweep(path)
    sensor = np.zeros(len(sweep.points), np.uint8)
    return SweepPoints(sweep.points, sweep.intensity, sensor, None, sweep.instances, sweep.times)
