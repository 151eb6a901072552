"""``sequence_tracks.json`` of a NuRec reconstruction: a cuboid over time for each actor.

Layout (NVIDIA's NuRec, ``CuboidTracks``): an object whose one entry, of any name, holds ``tracks_data`` with a list per
field (``tracks_id``, ``tracks_poses`` as x y z and a quaternion xyzw, ``tracks_timestamps_us``, ``tracks_label_class``,
``tracks_flags``) and ``cuboidtracks_data.cuboids_dims``: length, width, height in metres. Older files leave the outer
object out. The file lies in the reconstruction's ``.usdz`` package, or beside it.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X, build_poses
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.scene.track import Track

NAME = "sequence_tracks.json"
MOVING_FLAGS = ("DYNAMIC", "CONTROLLABLE")
_LONGEST = 256 << 20
_MOST_TRACKS = 65_000
_REMEDY = "Take the file from NuRec's package again"
_CHUNK = "instdrive"


@dataclass(frozen=True)
class SequenceTracks:
    """Actors of a reconstruction."""

    tracks: tuple[Track, ...]
    """Times in seconds since `start`; poses in the world of the reconstruction."""
    start: int
    """Microseconds of the first pose of any track."""


def read_sequence_tracks(path: Path) -> SequenceTracks:
    """Read the tracks of a bare file, or of a package that holds one. Raises DataError naming what is wrong."""
    text = _read_text(Path(path))
    try:
        content = parse_bounded_json(text)
    except ValueError as error:
        raise DataError(path, f"{NAME} is no JSON ({error})", _REMEDY) from error
    return parse_sequence_tracks(Path(path), content)


def parse_sequence_tracks(path: Path, content: Any) -> SequenceTracks:
    """Build tracks of parsed JSON; `path` is named in errors."""
    holder = _find_holder(path, content)
    data, cuboids = holder["tracks_data"], holder.get("cuboidtracks_data")
    names = ("tracks_id", "tracks_poses", "tracks_timestamps_us", "tracks_label_class")
    columns = [_require_list(path, data, name) for name in names]
    sizes = _require_list(path, cuboids, "cuboids_dims")
    flags = data.get("tracks_flags") or ["DYNAMIC"] * len(sizes)
    if len({len(column) for column in (*columns, sizes, flags)}) != 1:
        raise DataError(path, "the lists of tracks_data and cuboids_dims are not of one length", _REMEDY)
    if len(sizes) > _MOST_TRACKS:
        raise DataError(path, f"it has {len(sizes)} tracks, more than {_MOST_TRACKS}", _REMEDY)
    stamps = [_require_stamps(path, values, f"tracks_timestamps_us[{row}]") for row, values in enumerate(columns[2])]
    start = min((int(values[0]) for values in stamps), default=0)
    known: set[str] = set()
    tracks = []
    for row, (name, poses, _, label) in enumerate(zip(*columns, strict=True)):
        if not isinstance(name, str | int) or isinstance(name, bool) or str(name) in known:
            problem = f"tracks_id[{row}] is {str(name)[:60]!r}, no name or one that is there twice"
            raise DataError(path, problem, _REMEDY)
        known.add(str(name))
        shown = _require_rows(path, poses, (len(stamps[row]), 7), f"tracks_poses[{row}]")
        size = _require_rows(path, [sizes[row]], (1, 3), f"cuboids_dims[{row}]")[0]
        if not (size > 0).all():
            raise DataError(path, f"cuboids_dims[{row}] has a side that is not above 0", _REMEDY)
        if not (np.linalg.norm(shown[:, 3:], axis=1) > 1e-6).all():
            raise DataError(path, f"tracks_poses[{row}] has a quaternion of length 0", _REMEDY)
        world_from_box = build_poses(np.roll(shown[:, 3:], 1, axis=1), shown[:, :3])
        world_from_box[:, :3, :3] = world_from_box[:, :3, :3] @ BOX_FROM_FORWARD_X.T
        times = (stamps[row] - start) / 1e6
        dimensions = np.abs(BOX_FROM_FORWARD_X) @ size
        tracks.append(Track(str(name), str(label), dimensions, times, world_from_box, _is_moving(flags[row])))
    return SequenceTracks(tuple(tracks), start)


def describe_tracks(tracks: Sequence[Track], start: int = 0) -> dict[str, Any]:
    """Describe tracks as NuRec does, `start` being the microseconds of their second 0."""
    forward = [track.world_from_box[:, :3, :3] @ BOX_FROM_FORWARD_X for track in tracks]
    quats = [np.roll(quaternion_from_matrix(turn), -1, axis=1) for turn in forward]
    poses = [np.c_[track.world_from_box[:, :3, 3], quat].tolist() for track, quat in zip(tracks, quats, strict=True)]
    return {
        "tracks_data": {
            "tracks_id": [track.id for track in tracks],
            "tracks_poses": poses,
            "tracks_timestamps_us": [[start + round(time * 1e6) for time in track.times.tolist()] for track in tracks],
            "tracks_label_class": [track.label for track in tracks],
            "tracks_flags": ["CONTROLLABLE" if track.moving else "NONE" for track in tracks],
        },
        "cuboidtracks_data": {
            "cuboids_dims": [(np.abs(BOX_FROM_FORWARD_X.T) @ track.dimensions).tolist() for track in tracks]
        },
    }


def write_sequence_tracks(path: Path, found: SequenceTracks) -> None:
    """Write the tracks as a bare file, atomically."""
    with open_atomically(Path(path)) as out:
        out.write(json.dumps({_CHUNK: describe_tracks(found.tracks, found.start)}, indent=1).encode())


def read_text_file(path: Path) -> bytes:
    """Read a file of NuRec as a whole. Raises DataError where it is missing or longer than any drive needs."""
    try:
        if require_plain_file(path).stat().st_size > _LONGEST:
            raise DataError(path, f"it is longer than {_LONGEST >> 20} MB", _REMEDY)
        return path.read_bytes()
    except OSError as error:
        raise DataError(path, f"it cannot be read ({error.strerror or error})", "Check the path") from error


def _read_text(path: Path) -> bytes:
    file = require_plain_file(path)
    if not zipfile.is_zipfile(file):
        return read_text_file(path)
    try:
        with zipfile.ZipFile(file) as package, package.open(NAME) as member:
            text = member.read(_LONGEST + 1)
    except KeyError as error:
        remedy = "NuRec writes it with checkpoint.artifact.sequence_tracks.enabled=true"
        raise DataError(path, f"the package holds no {NAME}", remedy) from error
    except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, ValueError, NotImplementedError) as error:
        raise DataError(path, f"{NAME} in the package is damaged ({error})", _REMEDY) from error
    if len(text) > _LONGEST:
        raise DataError(path, f"{NAME} is longer than {_LONGEST >> 20} MB", _REMEDY)
    return text


def _find_holder(path: Path, content: Any) -> dict[str, Any]:
    values = [content, *(content.values() if isinstance(content, dict) else ())]
    for value in values:
        if isinstance(value, dict) and isinstance(value.get("tracks_data"), dict):
            return value
    raise DataError(path, "it has no tracks_data", _REMEDY)


def _require_list(path: Path, holder: Any, name: str) -> list[Any]:
    value = holder.get(name) if isinstance(holder, dict) else None
    if not isinstance(value, list):
        raise DataError(path, f"{name} is missing or no list", _REMEDY)
    return value


def _require_stamps(path: Path, values: Any, name: str) -> Float64[ndarray, " t"]:
    stamps = _require_rows(path, [values], (1, len(values) if isinstance(values, list) else 0), name)[0]
    if not len(stamps) or not (np.diff(stamps) > 0).all() or not np.abs(stamps[[0, -1]]).max() < 2**53:
        raise DataError(path, f"{name} is empty or does not rise", _REMEDY)
    return stamps


def _require_rows(path: Path, value: Any, shape: tuple[int, int], name: str) -> Float64[ndarray, "n c"]:
    """Require a list of equally long lists of finite numbers."""
    fits = isinstance(value, list) and len(value) == shape[0]
    fits = fits and all(isinstance(row, list) and len(row) == shape[1] for row in value)
    if not fits or not all(isinstance(n, int | float) and not isinstance(n, bool) for row in value for n in row):
        raise DataError(path, f"{name} is not {shape[0]} × {shape[1]} numbers", _REMEDY)
    try:
        rows = np.array(value, np.float64).reshape(shape)
    except OverflowError as error:
        raise DataError(path, f"{name} holds a number that is too large", _REMEDY) from error
    if not (np.abs(rows) < 1e18).all():
        raise DataError(path, f"{name} holds a number that is too large", _REMEDY)
    return rows


def _is_moving(flags: Any) -> bool:
    """Whether flags, given as a name, a bit mask or a list of them, say that the actor moves."""
    listed = flags if isinstance(flags, list) else [flags]
    return any(flag & 1 if isinstance(flag, int) else str(flag).upper() in MOVING_FLAGS for flag in listed)
