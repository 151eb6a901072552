"""The poses of one actor as JSON, beside the file that holds its splats in its own frame."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.json_value import parse_json
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.formats.objects.json_file import CONVENTIONS, describe_track
from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions
from instdrive_core.scene.track import Track

FORMAT_NAME, FORMAT_VERSION = "instdrive poses", 1
_SAID = {name: CONVENTIONS[name] for name in ("length", "axes", "track", "time")}


def write_poses(path: str | Path, track: Track, origin: Float64[ndarray, "3"], splats: str) -> None:
    """Write a track as JSON, atomically.

    Args:
        path: the .json file.
        track: relative to `origin`; positions are kept to 1e-7 m, rotations to 1e-9.
        origin: of the scene, in the data set's world (metres).
        splats: name of the file, in the same folder, with the splats in the track's frame.
    """
    content = {
        "format": FORMAT_NAME,
        "version": FORMAT_VERSION,
        "conventions": _SAID,
        "origin": origin.tolist(),
        "splats": splats,
        "track": describe_track(track),
    }
    write_bytes(path, (json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())


def read_poses(path: str | Path) -> tuple[Track, Float64[ndarray, "3"], Path]:
    """Read the track, the scene's origin and the splats' file that `write_poses` wrote. Raises DataError."""
    path = Path(path)
    try:
        content = parse_json(require_plain_file(path).read_bytes())
        if content["format"] != FORMAT_NAME or content["version"] != FORMAT_VERSION:
            raise ValueError(f"'format' is {content['format']!r}, version {content['version']!r}")
        fields = content["track"]
        times, positions = np.array(fields["times"], float), np.array(fields["positions"], float)
        quats, origin = np.array(fields["rotations"], float), np.array(content["origin"], float)
        if positions.shape != (len(times), 3) or quats.shape != (len(times), 4) or origin.shape != (3,):
            raise ValueError(f"{len(times)} times do not fit positions {positions.shape}, rotations {quats.shape}")
        poses = np.tile(np.eye(4), (len(times), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = matrix_from_quaternion(normalize_quaternions(quats)), positions
        size = np.array([fields["size"][name] for name in ("width", "length", "height")], float)
        track = Track(str(fields["id"]), str(fields["label"]), size, times, poses, bool(fields["moving"]))
        return track, origin, path.parent / Path(str(content["splats"])).name
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        problem = f"the file holds no poses of an actor ({type(error).__name__}: {error})"
        raise DataError(path, problem, "Export the actor again") from error
