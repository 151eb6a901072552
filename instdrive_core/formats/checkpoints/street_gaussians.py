"""StreetGaussians' ``trained_model/iteration_N.pth``: background, moving objects and a sky.

Layout (Yan et al. 2024, ``lib/models``): ``{"background": state, "obj_003": state, …, "actor_pose", "sky_cubemap",
"iter"}``, states with ``xyz, feature_dc, feature_rest, scaling, rotation, opacity, semantic``. An object's constant
colour is a short Fourier series over its frames, ``feature_dc`` (n, f, 3).

The file holds no tracks, only their corrections. They are read from the data set that it was trained on, as its
converter writes it: ``track/track_info.txt`` (boxes in the car's axes, x forward) and ``ego_pose/NNNNNN.txt``, in the
file's folder or up to three folders above. The scene's origin is the mean of all the car's places, as in training.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.files.torch_checkpoint import TorchCheckpoint
from instdrive_core.formats.allocation import ReadOptions
from instdrive_core.formats.checkpoints.actor_boxes import BOX_FROM_FORWARD_X, turn_into_box
from instdrive_core.formats.checkpoints.cube_texture import read_cube_sky
from instdrive_core.formats.checkpoints.splat_part import REMEDY, FieldNames, read_parts, view_part
from instdrive_core.instances.table import build_instance_table
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

STEP_SECONDS = 0.1
_FIELDS = FieldNames("xyz", "rotation", "scaling", "opacity", "feature_dc", "feature_rest")
_OBJECT = re.compile(r"obj_(\d{1,9})")
_BACKGROUND, _TRACKS, _EGO = "background", Path("track") / "track_info.txt", "ego_pose"
_MAX_TEXT, _MAX_FRAME = 64 << 20, 1 << 20
_MOST_OBJECTS = 10_000
_COPY = "Copy it from the data set again"


def find_street(file: TorchCheckpoint) -> Mapping[Any, Any] | None:
    """The states of StreetGaussians' models by name; None where it is another checkpoint."""
    items = file.find_items(file.content)
    return items if items is not None and "xyz" in (file.find_items(items.get(_BACKGROUND)) or {}) else None


def read_street(file: TorchCheckpoint, models: Mapping[Any, Any], options: ReadOptions) -> Scene:
    """Read the background, the objects whose tracks are found, and the sky. Raises DataError."""
    left_out: list[str] = []
    names = [name for name in models if isinstance(name, str) and _OBJECT.fullmatch(name)]
    if len(names) > _MOST_OBJECTS:
        raise DataError(file.path, f"it has {len(names)} objects, more than {_MOST_OBJECTS}", REMEDY)
    tracks = _find_tracks(file.path, names, left_out)
    states = {name: file.find_items(models[name]) or {} for name in (_BACKGROUND, *tracks)}
    parts = [view_part(file, state, _FIELDS, name) for name, state in states.items()]
    gaussians, places = read_parts(file.path, parts, options)
    nodes = np.zeros(len(gaussians), np.uint16)
    start = len(parts[0])
    for node, (track, part, rows) in enumerate(zip(tracks.values(), parts[1:], places[1:], strict=True), start=1):
        nodes[rows] = node
        moment = len(track.times) // 2 if options.time is None else int(np.abs(track.times - options.time).argmin())
        share = (track.times[moment] - track.times[0]) / max(track.times[-1] - track.times[0], 1e-9)
        view = gaussians.select(rows)
        if len(part.sh_dc.shape) == 3 and part.sh_dc.shape[1] > 1:
            first = -start % options.keep_every
            series = part.sh_dc.read()[first :: options.keep_every]
            view.sh_dc[:] = np.einsum("nfc,f->nc", series, _build_waves(float(share), series.shape[1]))
        pose = track.world_from_box[moment].copy()
        pose[:3, :3] = pose[:3, :3] @ BOX_FROM_FORWARD_X
        turn_into_box(view, pose, BOX_FROM_FORWARD_X, np.zeros(3))
        start += len(part)
    if tracks and any(len(part.sh_dc.shape) == 3 and part.sh_dc.shape[1] > 1 for part in parts[1:]):
        left_out.append("how the objects' colours change: all have those of one frame")
    if any(name in models for name in ("color_correction", "pose_correction")):
        left_out.append("corrections of colours or cameras per photo, as the checkpoint does not hold the cameras")
    sky = None
    if "sky_cubemap" in models:
        parameters = file.find_items((file.find_items(models["sky_cubemap"]) or {}).get("params")) or {}
        sky = read_cube_sky(file, parameters.get("sky_cube_map"), np.eye(3), left_out)
    ids = nodes.astype(np.uint32)
    titles = {row: track.id for row, track in enumerate(tracks.values(), start=1)}
    labels = {row: track.label for row, track in enumerate(tracks.values(), start=1)}
    return Scene(
        gaussians=gaussians,
        instance_ids=ids,
        codewords=np.zeros(len(gaussians), np.uint32),
        nodes=nodes,
        table=build_instance_table(ids, gaussians.means, None, nodes, titles, labels),
        actors=tuple(tracks.values()),
        sky=sky,
        left_out=tuple(left_out),
    )


def _build_waves(share: float, count: int) -> Float64[ndarray, " {count}"]:
    """Basis of the series over a track, at a share of it in [0, 1]: cosines at even places, sines at odd ones."""
    steps = np.arange(count)
    return np.where(steps % 2, np.sin(np.pi * share * (steps + 1)), np.cos(np.pi * share * steps))


def _find_tracks(path: Path, names: list[str], left_out: list[str]) -> dict[str, Track]:
    if not names:
        return {}
    folders = [path.parent, *list(path.absolute().parents)[1:4]]
    root = next((folder for folder in folders if (folder / _TRACKS).is_file() and (folder / _EGO).is_dir()), None)
    if root is None:
        left_out.append(
            f"{len(names)} moving objects, as their tracks are in the data set: copy its folders 'track' and "
            f"'{_EGO}' beside the checkpoint"
        )
        return {}
    ego = _read_ego_poses(root / _EGO)
    boxes = _read_boxes(root / _TRACKS)
    tracks = {}
    for name in names:
        found = {frame: box for frame, box in boxes.get(int(name[4:]), {}).items() if frame in ego}
        if found:
            tracks[name] = _build_track(name, found, ego)
        else:
            left_out.append(f"{name}, as {_TRACKS} has no box of it")
    if tracks:
        left_out.append("corrections of the objects' tracks: the tracks are those of the data set")
    return tracks


def _build_track(name: str, boxes: dict[int, tuple[str, list[float]]], ego: Mapping[int, ndarray]) -> Track:
    frames = sorted(boxes)
    poses = np.empty((len(frames), 4, 4))
    sizes = np.array([box[:3] for _, box in boxes.values()]).max(axis=0)
    for row, frame in enumerate(frames):
        x, y, z, heading = boxes[frame][1][3:7]
        pose = np.eye(4)
        cosine, sine = math.cos(heading), math.sin(heading)
        pose[:2, :2], pose[:3, 3] = [[cosine, -sine], [sine, cosine]], (x, y, z)
        poses[row] = ego[frame] @ pose
        poses[row, :3, :3] = poses[row, :3, :3] @ BOX_FROM_FORWARD_X.T
    height, width, length = sizes
    times = np.array(frames) * STEP_SECONDS
    return Track(name, boxes[frames[0]][0], np.array([width, length, height]), times, poses, moving=True)


def _read_boxes(path: Path) -> dict[int, dict[int, tuple[str, list[float]]]]:
    """By track and frame: class, and height, width, length, x, y, z and heading."""
    boxes: dict[int, dict[int, tuple[str, list[float]]]] = {}
    for number, line in enumerate(_read_text(path).splitlines()[1:], start=2):
        words = line.split()
        try:
            frame, track, label = int(words[0]), int(words[1]), words[2]
            box = [float(word) for word in words[4:11]]
            if len(box) < 7 or not np.isfinite(box).all() or not 0 <= frame < _MAX_FRAME or max(map(abs, box)) > 1e9:
                raise ValueError("numbers are missing or out of range")
        except (ValueError, IndexError, OverflowError) as error:
            problem = f"line {number} is no box ({str(error)[:100]})"
            raise DataError(path, problem, _COPY) from error
        boxes.setdefault(track, {})[frame] = label[:80], box
    return boxes


def _read_ego_poses(folder: Path) -> dict[int, ndarray]:
    """world_from_car by frame, around the mean of all places."""
    files = {int(file.stem): file for file in folder.iterdir() if re.fullmatch(r"\d{1,9}\.txt", file.name)}
    poses = {}
    for frame, file in sorted(files.items()):
        try:
            pose = np.array([float(word) for word in _read_text(file).split()]).reshape(4, 4)
            rotation = pose[:3, :3]
            if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or not np.isfinite(pose).all():
                raise ValueError("it does more than turn and shift")
        except ValueError as error:
            raise DataError(file, f"is no pose of 4 x 4 numbers ({error})", _COPY) from error
        poses[frame] = pose
    if poses:
        center = np.mean([pose[:3, 3] for pose in poses.values()], axis=0)
        for pose in poses.values():
            pose[:3, 3] -= center
    return poses


def _read_text(path: Path) -> str:
    try:
        with require_plain_file(path).open("rb") as file:
            return file.read(_MAX_TEXT).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(path, f"cannot be read ({error})", _COPY) from error
