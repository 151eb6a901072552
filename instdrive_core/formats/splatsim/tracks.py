"""``sequence_tracks.json`` of a bundle: where every moving thing is, at every moment."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X, build_poses
from instdrive_core.formats.splatsim.fields import require_equal, take, take_vector
from instdrive_core.formats.splatsim.layout import FRAMES, OWN_DATA, REMEDY, TRACKS, TRACKS_SCHEMA
from instdrive_core.maths.rotations import normalize_quaternions, quaternion_from_matrix
from instdrive_core.scene.track import Track

_MOST_TRACKS = 65_000
_STANDS = 0.5
"""Metres within which all places of a thing that stands lie; trackers are no better."""
_MICROSECOND = 1e-6


def parse_tracks(path: Path, document: Any) -> tuple[Track, ...]:
    """Parse the tracks; their times are seconds since the first of all. Raises DataError naming what is wrong."""
    require_equal(path, document.get("schema"), TRACKS_SCHEMA, f"the schema of {TRACKS}")
    require_equal(path, document.get("frame"), "world", f"the frame of {TRACKS}")
    require_equal(path, document.get("frame_convention"), FRAMES, f"the frame convention of {TRACKS}")
    entries = take(path, document, "tracks", list, TRACKS)
    if len(entries) > _MOST_TRACKS:
        raise DataError(path, f"{TRACKS} has {len(entries)} tracks, more than {_MOST_TRACKS}", REMEDY)
    stamps = [_parse_stamps(path, entry, f"track {row}") for row, entry in enumerate(entries)]
    own = document.get(OWN_DATA)
    zero = own.get("time_zero_us") if isinstance(own, dict) else None
    start = zero if isinstance(zero, int) else min((int(each[0]) for each in stamps), default=0)
    tracks = tuple(_parse_track(path, entry, times, start) for entry, times in zip(entries, stamps, strict=True))
    names = [track.id for track in tracks]
    if len(set(names)) < len(names):
        raise DataError(path, f"{TRACKS} names a track twice", REMEDY)
    return tracks


def describe_tracks_of_bundle(tracks: Sequence[Track]) -> dict[str, Any]:
    """Describe tracks as a document; moments before second 0 shift them all, as stamps are not negative."""
    first = min((float(track.times[0]) for track in tracks), default=0.0)
    zero = max(0, -round(first / _MICROSECOND))
    return {
        "schema": TRACKS_SCHEMA,
        "frame": "world",
        "frame_convention": FRAMES,
        "tracks": [_describe_track(track, zero) for track in tracks],
        OWN_DATA: {"time_zero_us": zero},
    }


def get_length_width_height(track: Track) -> list[float]:
    """The box's sides in the order of bundles, metres."""
    return (np.abs(BOX_FROM_FORWARD_X.T) @ track.dimensions).tolist()


def _parse_stamps(path: Path, entry: Any, where: str) -> list[int]:
    frames = take(path, entry, "frames", list, where)
    stamps = [take(path, frame, "timestamp_us", int, f"a frame of {where}") for frame in frames]
    rising = all(one < other for one, other in pairwise(stamps))
    if not stamps or not rising or not 0 <= stamps[0] <= stamps[-1] < 1 << 63:
        raise DataError(path, f"the timestamps of {where} of {TRACKS} are absent or do not rise", REMEDY)
    return stamps


def _parse_track(path: Path, entry: Any, stamps: list[int], start: int) -> Track:
    name = take(path, entry, "track_id", str, "a track")
    size = take_vector(path, entry, "size", 3, f"track {name!r}")
    if not (size > 0).all():
        raise DataError(path, f"'size' of track {name!r} has a side that is not above 0", REMEDY)
    where = f"a frame of track {name!r}"
    places = np.stack([take_vector(path, frame, "translation", 3, where) for frame in entry["frames"]])
    quats = np.stack([take_vector(path, frame, "rotation", 4, where) for frame in entry["frames"]])
    if not (np.linalg.norm(quats, axis=1) > 1e-6).all():
        raise DataError(path, f"'rotation' of {where} has length 0", REMEDY)
    poses = build_poses(np.roll(quats, 1, axis=1), places)
    poses[:, :3, :3] = poses[:, :3, :3] @ BOX_FROM_FORWARD_X.T
    times = np.array([stamp - start for stamp in stamps], np.float64) * _MICROSECOND
    label = entry.get("class_name")
    return Track(
        name,
        label if isinstance(label, str) and label else "object",
        np.abs(BOX_FROM_FORWARD_X) @ size,
        times,
        poses,
        _is_moving(entry, places),
    )


def _is_moving(entry: dict[str, Any], places: Float64[ndarray, "t 3"]) -> bool:
    metadata = entry.get("metadata")
    own = metadata.get(OWN_DATA) if isinstance(metadata, dict) else None
    if isinstance(own, dict) and isinstance(own.get("moving"), bool):
        return own["moving"]
    return bool(np.ptp(places, axis=0).max() > _STANDS)


def _describe_track(track: Track, zero: int) -> dict[str, Any]:
    turns = quaternion_from_matrix(track.world_from_box[:, :3, :3] @ BOX_FROM_FORWARD_X)
    quats = np.roll(normalize_quaternions(turns.astype(np.float64)), -1, axis=1)
    stamps = (np.round(track.times / _MICROSECOND).astype(np.int64) + zero).tolist()
    places = track.world_from_box[:, :3, 3]
    return {
        "track_id": track.id,
        "class_name": track.label or "object",
        "size": get_length_width_height(track),
        "flag": "NONE",
        "frames": [
            {"timestamp_us": stamp, "translation": place, "rotation": quat}
            for stamp, place, quat in zip(stamps, places.tolist(), quats.tolist(), strict=True)
        ],
        "metadata": {OWN_DATA: {"moving": track.moving}},
    }
