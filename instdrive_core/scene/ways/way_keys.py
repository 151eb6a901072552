"""Keys of a way: the few that describe a track, and changes of one of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import PathKey, sample_path

TOLERANCE = 0.1
"""Metres that a way between its keys may deviate from the track that it describes."""
CLOSEST = 0.05
"""Seconds between two keys, at least."""
USUAL_SPEED = 5.0
"""m/s at which something drives to a key that is added, where it had no speed before."""
Keys = tuple[PathKey, ...]


def thin_track(track: Track, tolerance: float = TOLERANCE) -> Keys:
    """Describe a track by as few keys as will do; a single one, with its heading, where it stands all the time."""
    places = track.world_from_box[:, :2, 3]
    if float(np.ptp(places, axis=0).max()) <= tolerance:
        middle = track.world_from_box[len(places) // 2]
        heading = math.atan2(middle[1, 1], middle[0, 1])
        return (PathKey(float(track.times[0]), float(middle[0, 3]), float(middle[1, 3]), heading),)
    return thin_samples(track.times, places, tolerance)


def thin_samples(times: Float64[ndarray, " n"], places: Float64[ndarray, "n 2"], tolerance: float) -> Keys:
    """Keep so many samples that the way through them misses none by more than `tolerance` metres.

    The sample that is missed most becomes the next key, as Douglas and Peucker (1973) thin lines; in time as well as
    on the ground, so that a stop is kept as well as a bend.
    """
    kept = [0, len(times) - 1]
    while True:
        keys = tuple(PathKey(float(times[row]), *places[row].tolist()) for row in kept)
        missed = np.linalg.norm(sample_path(keys, times).places - places, axis=1)
        missed[kept] = 0.0
        worst = int(np.argmax(missed))
        if missed[worst] <= tolerance:
            return keys
        kept = sorted([*kept, worst])


def move_key(keys: Keys, index: int, x: float, y: float) -> Keys:
    """Put a key elsewhere (metres); headings follow the way then."""
    moved = (*keys[:index], replace(keys[index], x=x, y=y), *keys[index + 1 :])
    return moved if len(moved) == 1 else _drop_headings(moved)


def retime_key(keys: Keys, index: int, time: float) -> Keys:
    """Be at a key at another time (seconds), between those of its neighbours."""
    low = keys[index - 1].time + CLOSEST if index > 0 else -np.inf
    high = keys[index + 1].time - CLOSEST if index + 1 < len(keys) else np.inf
    time = float(min(max(time, low), high))
    return (*keys[:index], replace(keys[index], time=time), *keys[index + 1 :])


def insert_key(keys: Keys, time: float) -> tuple[Keys, int]:
    """Add a key where the vehicle is at a time (seconds); returns all keys, and which one it is.

    Where another key is too close, that is the one.
    """
    nearest = min(range(len(keys)), key=lambda index: abs(keys[index].time - time))
    if abs(keys[nearest].time - time) < CLOSEST:
        return keys, nearest
    place = sample_path(keys, np.array([time])).places[0]
    index = sum(key.time < time for key in keys)
    added = PathKey(time, float(place[0]), float(place[1]))
    return _drop_headings((*keys[:index], added, *keys[index:])), index


def extend_way(keys: Keys, x: float, y: float, start: float) -> Keys:
    """Drive on to a place (metres) after the last key, as fast as before.

    What has a single key stands there until `start` seconds, and drives then.
    """
    if len(keys) == 1:
        keys = (replace(keys[0], time=max(start, keys[0].time)),)
    last = keys[-1]
    speed = 0.0
    if len(keys) > 1:
        before = keys[-2]
        speed = float(np.hypot(last.x - before.x, last.y - before.y)) / (last.time - before.time)
    way = float(np.hypot(x - last.x, y - last.y))
    seconds = max(way / (speed if speed > 1.0 else USUAL_SPEED), 2 * CLOSEST)
    return _drop_headings((*keys, PathKey(last.time + seconds, x, y)))


def delete_key(keys: Keys, index: int) -> Keys:
    """Take a key away; the last one stays."""
    return keys if len(keys) == 1 else (*keys[:index], *keys[index + 1 :])


def find_time_at(keys: Sequence[PathKey], x: float, y: float) -> tuple[float, float]:
    """Find when a way comes nearest to a place (metres); returns the time (seconds) and how near it comes."""
    times = np.linspace(keys[0].time, keys[-1].time, 40 * len(keys))
    places = sample_path(keys, times).places
    apart = np.hypot(places[:, 0] - x, places[:, 1] - y)
    nearest = int(np.argmin(apart))
    return float(times[nearest]), float(apart[nearest])


def _drop_headings(keys: Keys) -> Keys:
    return tuple(replace(key, heading=None) for key in keys)
