"""Where StreetGaussians' objects were: from the data set that a run was trained on, as its converter writes it.

Neither the checkpoint nor the .ply of a run holds tracks. They are in ``track/track_info.txt`` (boxes in the car's
axes, x forward) and ``ego_pose/NNNNNN.txt`` of the data set (Yan et al. 2024, ``lib/utils/waymo_utils.py``). The
scene's origin is the mean of all the car's places, as in training. A run's ``cfg_args`` names the data set's folder,
its ``configs/config_NNNNNN.yaml`` the frames that were trained on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X
from instdrive_core.scene.track import Track

STEP_SECONDS = 0.1
STREET_OBJECT = re.compile(r"obj_(\d{1,9})")
_TRACKS, _EGO, _SETTINGS, _CONFIGS = Path("track") / "track_info.txt", "ego_pose", "cfg_args", "configs"
_TRACKED = Path("track") / "track_info_castrack.txt"
_MAX_TEXT, _MAX_FRAME, _MAX_SETTINGS = 64 << 20, 1 << 20, 1 << 20
_FOLDERS_ABOVE, _FARTHEST = 3, 1e9
_FRAMES = re.compile(
    r"^\s*selected_frames:\s*(?:\[\s*(\d{1,7}),\s*(\d{1,7})\s*\]|-\s*(\d{1,7})\s*-\s*(\d{1,7})\s)", re.M
)
_COPY = "Copy it from the data set again"


@dataclass(frozen=True)
class _Run:
    """What the settings of a run say."""

    source: Path | None = None
    """The data set's folder."""
    first: int = 0
    last: int = _MAX_FRAME
    """First and last frame that it was trained on."""
    uses_tracker: bool = False
    """Whether it was trained on a tracker's boxes, not on those of the data set."""


def find_street_tracks(path: Path, names: Sequence[str], data: Path | None, left_out: list[str]) -> dict[str, Track]:
    """Find the tracks of objects; what is missing is said in `left_out`.

    Args:
        path: the checkpoint or .ply.
        names: of its objects, ``obj_003``.
        data: the data set's folder; None looks beside the file, up to three folders above, and where the run's
            settings say.
        left_out: gets a sentence for what has no track.

    Raises DataError where the data set's files are damaged, or `data` holds none.
    """
    if not names:
        return {}
    run = _read_run(path)
    root = _find_data_set(path, data, run)
    if root is None:
        left_out.append(
            f"tracks of {len(names)} moving objects, which lie in a row above the street: tracks are in the data set's "
            f"folders 'track' and '{_EGO}'. Give that data set (`instdrive convert --data FOLDER`), or copy or link "
            "both folders beside the file"
        )
        return {}
    ego = _read_ego_poses(root / _EGO)
    boxes = _read_boxes(root / (_TRACKED if run.uses_tracker and (root / _TRACKED).is_file() else _TRACKS))
    tracks, missing = {}, []
    for name in names:
        match = STREET_OBJECT.fullmatch(name)
        known = boxes.get(int(match[1]), {}) if match else {}
        known = {frame: box for frame, box in known.items() if frame in ego}
        trained = {frame: box for frame, box in known.items() if run.first <= frame <= run.last}
        if known:
            tracks[name] = _build_track(name, trained or known, ego)
        else:
            missing.append(name)
    if missing:
        named = f"{', '.join(missing[:3])}{' …' if len(missing) > 3 else ''}"
        left_out.append(f"tracks of {named}, which lie in a row above the street: {root / _TRACKS} has no box of them")
    if tracks:
        left_out.append("corrections of the objects' tracks: the tracks are those of the data set")
    return tracks


def _find_data_set(path: Path, data: Path | None, run: _Run) -> Path | None:
    if data is not None:
        if not _holds_tracks(data):
            remedy = f"Give the folder that StreetGaussians was trained on; it holds {_TRACKS} and {_EGO}/000000.txt"
            raise DataError(data, f"it holds no {_TRACKS} with a folder {_EGO} beside 'track'", remedy)
        return data
    folders = [path.parent, *list(path.absolute().parents)[1 : 1 + _FOLDERS_ABOVE]]
    if run.source is not None:
        folders.append(run.source)
    return next(filter(_holds_tracks, folders), None)


def _holds_tracks(folder: Path) -> bool:
    try:
        return (folder / _TRACKS).is_file() and (folder / _EGO).is_dir()
    except (OSError, ValueError):
        return False


def _read_run(path: Path) -> _Run:
    """Read what ``cfg_args`` and the newest config of the run's folder say, if they are there."""
    folder = next((f for f in list(path.absolute().parents)[:4] if (f / _SETTINGS).is_file()), None)
    if folder is None:
        return _Run()
    source = re.search(r"\bsource_path='([^'\n\0]{1,1000})'", _read_settings(folder / _SETTINGS))
    configs = sorted(file for file in folder.glob(f"{_CONFIGS}/config_*.yaml") if file.is_file())[-1:]
    text = _read_settings(configs[0]) if configs else ""
    match = _FRAMES.search(text)
    first, last = (int(word) for word in match.groups() if word is not None) if match else (0, _MAX_FRAME)
    uses_tracker = re.search(r"^\s*use_tracker:\s*true\s*$", text, re.M) is not None
    return _Run(Path(source[1]) if source else None, first, last, uses_tracker)


def _read_settings(path: Path) -> str:
    try:
        with require_plain_file(path).open("rb") as file:
            return file.read(_MAX_SETTINGS).decode(errors="replace")
    except OSError:
        return ""


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
            if (
                len(box) < 7
                or not np.isfinite(box).all()
                or not 0 <= frame < _MAX_FRAME
                or max(map(abs, box)) > _FARTHEST
            ):
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
            # Sizes first: they also keep products finite.
            is_small = np.abs(rotation).max() < 2 and np.abs(pose).max() < _FARTHEST
            if not is_small or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
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
