"""Found tracks as a JSON file.

One object: ``version`` (1), ``clip`` (its name), ``origin`` (metres: added to all places gives the clip's own world),
``notes`` (texts), and ``tracks``, each with ``id``, ``label``, ``dimensions`` (width, length, height in metres),
``times`` (seconds as the clip counts them) and ``poses``, one a time: x, y, z of the box's centre (metres) and yaw
(radians, counterclockwise, 0 = the box's length along y).
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.json_fields import read_json, require_field, require_numbers
from instdrive_core.scene.track import Track
from instdrive_core.tracks.finder import FoundTracks

FILE = "tracks.json"
"""Its name beside a clip."""
VERSION = 1
MAX_VALUE = 1e9
"""Metres and seconds that no drive exceeds."""


def write_track_file(path: Path, found: FoundTracks, clip: Clip) -> None:
    """Write found tracks. Raises OSError where the file cannot be written."""
    entries = [
        {
            "id": track.id,
            "label": track.label,
            "dimensions": np.round(track.dimensions, 4).tolist(),
            "times": np.round(track.times, 6).tolist(),
            "poses": [np.round(_flat(pose), 5).tolist() for pose in track.world_from_box],
        }
        for track in found.tracks
    ]
    content = {
        "version": VERSION,
        "clip": clip.name,
        "origin": clip.origin.tolist(),
        "notes": list(found.notes),
        "tracks": entries,
    }
    write_bytes(path, (json.dumps(content) + "\n").encode())


def read_track_file(path: Path, clip: Clip) -> FoundTracks:
    """Read found tracks again, relative to the clip's origin.

    Raises DataError where the file is missing, broken, or of another clip.
    """
    content = read_json(path)
    if require_field(path, content, "version") != VERSION:
        raise DataError(path, f"has version {content['version']!r}, not {VERSION}", "Find the tracks again")
    if require_field(path, content, "clip") != clip.name:
        problem = f"holds the tracks of the clip {content['clip']!r}, not of {clip.name!r}"
        raise DataError(path, problem, "Find the tracks of this clip: instdrive tracks CLIP")
    origin = np.array(_numbers(path, require_field(path, content, "origin"), "origin", 3))
    notes = require_field(path, content, "notes")
    entries = require_field(path, content, "tracks")
    if not isinstance(entries, list) or not isinstance(notes, list):
        raise DataError(path, "the fields 'tracks' and 'notes' are no lists", "Find the tracks again")
    tracks = tuple(
        _track(path, entry, f"tracks[{number}].", origin - clip.origin) for number, entry in enumerate(entries)
    )
    if len({track.id for track in tracks}) < len(tracks):
        raise DataError(path, "two tracks have the same id", "Find the tracks again")
    return FoundTracks(tracks, tuple(str(note) for note in notes))


def _track(path: Path, entry: Any, where: str, shift: Float64[ndarray, "3"]) -> Track:
    names = [require_field(path, entry, key, where) for key in ("id", "label")]
    if not all(isinstance(name, str) and name for name in names):
        raise DataError(path, f"'{where}id' or '{where}label' is no text", "Find the tracks again")
    dimensions = np.array(_numbers(path, require_field(path, entry, "dimensions", where), f"{where}dimensions", 3))
    times = _numbers(path, require_field(path, entry, "times", where), f"{where}times")
    rows = require_field(path, entry, "poses", where)
    if not times or any(later <= earlier for earlier, later in pairwise(times)):
        raise DataError(path, f"the times of '{where}times' do not rise", "Find the tracks again")
    if not isinstance(rows, list) or len(rows) != len(times) or not (dimensions > 0).all():
        problem = f"'{where}' has {len(times)} times, yet not as many poses, or a size that is not positive"
        raise DataError(path, problem, "Find the tracks again")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for number, row in enumerate(rows):
        x, y, z, yaw = _numbers(path, row, f"{where}poses[{number}]", 4)
        poses[number, :2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        poses[number, :3, 3] = np.array([x, y, z]) + shift
    return Track(names[0], names[1], dimensions, np.array(times), poses, moving=True)


def _numbers(path: Path, value: Any, name: str, count: int | None = None) -> list[float]:
    found = require_numbers(path, value, name)
    if count is not None and len(found) != count:
        raise DataError(path, f"'{name}' has {len(found)} numbers, expected {count}", "Find the tracks again")
    if any(abs(one) > MAX_VALUE for one in found):
        raise DataError(path, f"'{name}' holds a number beyond {MAX_VALUE:g}", "Find the tracks again")
    return found


def _flat(pose: Float64[ndarray, "4 4"]) -> Float64[ndarray, "4"]:
    return np.array([*pose[:3, 3], np.arctan2(pose[1, 0], pose[0, 0])])
