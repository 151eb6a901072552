"""Tracks of vehicles that drive given ways: on the ground, heading along, over the whole drive."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.edits.bases.parameters import check_number_list, is_number
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.placement import find_ground_along, find_ground_below
from instdrive_core.errors import EditError
from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import PathKey, sample_path
from instdrive_core.wording import phrase

_STEP = 0.1
"""Seconds between the poses of a driven track, that of most LiDARs."""
_PROBE = 2.0
"""Metres between the places at which the ground is looked for."""
_LONGEST = 3600.0
_MOST_KEYS = 10_000
Keys = Sequence[Sequence[float]]
"""(time, x, y) or (time, x, y, heading) each: seconds, metres, radians."""


def check_keys(keys: Sequence[Sequence[float]]) -> Keys:
    """Check the keys of a way. Raises EditError naming the one that is wrong."""
    if isinstance(keys, str) or not 1 <= len(keys) <= _MOST_KEYS:
        raise EditError(phrase("a way needs from 1 to {most} keys", most=_MOST_KEYS))
    checked: list[tuple[float, ...]] = []
    for number, key in enumerate(keys, start=1):
        if isinstance(key, str) or len(key) not in (3, 4) or not all(is_number(value) for value in key):
            raise EditError(
                phrase(
                    "key {number} of the way is {key!r}, not time, x, y and if wanted the heading",
                    number=number,
                    key=key,
                )
            )
        checked.append(check_number_list(key, phrase("key {number} of the way", number=number), len(key)))
        if number > 1 and checked[-1][0] <= checked[-2][0]:
            raise EditError(phrase("the times of the way do not rise at key {number}", number=number))
    if checked[-1][0] - checked[0][0] > _LONGEST or max(abs(value) for key in checked for value in key) > 1e6:
        raise EditError("the way lasts over an hour, or leads over 1,000 km away")
    return tuple(checked)


def build_path_keys(keys: Keys) -> tuple[PathKey, ...]:
    """Build the keys as records."""
    return tuple(PathKey(key[0], key[1], key[2], key[3] if len(key) == 4 else None) for key in keys)


def find_drive_times(document: Document, keys: Keys) -> Float64[ndarray, " t"]:
    """Times of a driven track: those of the keys, and every 0.1 s of the drive, as tracks, photos and the way last."""
    scene = document.scene
    known = [keys[0][0], keys[-1][0], *(view.time for view in scene.views)]
    known += [float(time) for track in scene.actors for time in (track.times[0], track.times[-1])]
    first, last = min(known), max(max(known), min(known) + _STEP)
    even = np.linspace(first, last, max(1, math.ceil((last - first) / _STEP)) + 1)
    times = np.sort(np.r_[even, [key[0] for key in keys]])
    return times[np.r_[True, np.diff(times) > 1e-6]]


def drive_along(
    document: Document,
    ids: Sequence[int],
    keys: Keys,
    still: Float64[ndarray, "4 4"],
    height: float,
    track: Track,
) -> Track:
    """Give a track the poses of a way.

    Args:
        document: whose ground is driven on; what stands on it by these IDs is no ground.
        ids: instances of the vehicle.
        keys: of `check_keys`.
        still: a pose of the box where it stands on its ground now, from which its height over the ground and the
            heading of one that never moves are taken.
        height: of the box, metres.
        track: whose ID, label and size are kept.
    """
    start = math.atan2(still[1, 1], still[0, 1])
    times = find_drive_times(document, keys)
    driven = sample_path(build_path_keys(keys), times, start)
    clearance = _measure_clearance(document, ids, still, height)
    levels = _find_levels(document, ids, driven.places, float(still[2, 3]) - clearance)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    cosine, sine = np.cos(driven.headings), np.sin(driven.headings)
    # The box looks along its y: its x is to the right.
    poses[:, :2, 0] = np.stack([sine, -cosine], axis=1)
    poses[:, :2, 1] = np.stack([cosine, sine], axis=1)
    poses[:, :2, 3] = driven.places
    poses[:, 2, 3] = levels + clearance
    moving = bool(np.ptp(driven.places, axis=0).max() > 0.1)
    return Track(track.id, track.label, track.dimensions, times, poses, moving)


def _measure_clearance(document: Document, ids: Sequence[int], pose: Float64[ndarray, "4 4"], height: float) -> float:
    """Metres of the box's middle over the ground where it stands; half its height where no ground is found."""
    try:
        found = float(pose[2, 3]) - find_ground_below(document, ids, pose[:3, 3])
    except EditError:
        return height / 2
    return found if 0.2 * height < found < height else height / 2


def _find_levels(
    document: Document, ids: Sequence[int], places: Float64[ndarray, "n 2"], level: float
) -> Float64[ndarray, " n"]:
    """Height of the ground along a way: measured every few metres, even between, the last known where there is none."""
    gone = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))]
    probes = np.unique(np.searchsorted(gone, np.arange(0.0, gone[-1] + _PROBE, _PROBE)).clip(max=len(places) - 1))
    heights = find_ground_along(document, ids, np.c_[places[probes], np.full(len(probes), level)])
    known = ~np.isnan(heights)
    if not known.any():
        return np.full(len(places), level)
    return np.interp(gone, gone[probes[known]], heights[known])
