"""The speed of a vehicle over time, and driving the same way at other speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.vehicle_path import PathKey, sample_path
from instdrive_core.scene.ways.way_keys import thin_samples

MOST_SPEED = 60.0
"""m/s that a vehicle may drive."""
STEP = 0.05
"""Seconds between the samples by which speeds are added up."""
_TOLERANCE = 0.05
_STANDS = 1e-3


@dataclass(frozen=True)
class SpeedPoint:
    """How fast a vehicle is at a time."""

    time: float
    """Seconds."""
    speed: float
    """m/s."""


def sample_speeds(keys: Sequence[PathKey], times: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
    """Sample the speeds (m/s) of a way at times (seconds); 0 before its first and after its last key."""
    half = STEP / 2
    later, before = (sample_path(keys, times + shift).places for shift in (half, -half))
    inside = np.minimum(times + half, keys[-1].time) - np.maximum(times - half, keys[0].time)
    return np.linalg.norm(later - before, axis=1) / np.maximum(inside, half)


def list_speed_points(keys: Sequence[PathKey]) -> tuple[SpeedPoint, ...]:
    """List the speed at each key of a way."""
    speeds = sample_speeds(keys, np.array([key.time for key in keys]))
    return tuple(SpeedPoint(key.time, float(speed)) for key, speed in zip(keys, speeds, strict=True))


def drive_at_speeds(
    keys: Sequence[PathKey], before: Sequence[SpeedPoint], after: Sequence[SpeedPoint]
) -> tuple[PathKey, ...]:
    """Drive the same way at speeds that differ as the line through `after` differs from the line through `before`.

    It stands where the line through `after` is at 0, and once it has come to the end of the way; a way that is driven
    more slowly ends before that. Times of both lines rise.
    """
    first, last = keys[0].time, keys[-1].time
    times = np.linspace(first, last, max(2, round((last - first) / STEP) + 1))
    lines = [
        np.interp(times, [point.time for point in line], [point.speed for point in line]) for line in (before, after)
    ]
    wanted = np.clip(sample_speeds(keys, times) + lines[1] - lines[0], 0.0, MOST_SPEED)
    wanted[lines[1] <= _STANDS] = 0.0
    gone = np.r_[0.0, np.cumsum((wanted[1:] + wanted[:-1]) / 2 * np.diff(times))]
    places = sample_path(keys, times).places
    lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))]
    gone = np.minimum(gone, lengths[-1])
    moves = np.r_[True, np.diff(lengths) > 1e-9]  # a place is looked up by its length, where it was first
    there = np.stack([np.interp(gone, lengths[moves], places[moves, axis]) for axis in (0, 1)], axis=1)
    return thin_samples(times, there, _TOLERANCE)


def move_point(points: tuple[SpeedPoint, ...], index: int, time: float, speed: float) -> tuple[SpeedPoint, ...]:
    """Move a point of a line of speeds; it stays between its neighbours, and the ends keep their times."""
    own = points[index]
    if 0 < index < len(points) - 1:
        time = min(max(time, points[index - 1].time + STEP), points[index + 1].time - STEP)
    else:
        time = own.time
    moved = SpeedPoint(time, min(max(speed, 0.0), MOST_SPEED))
    return (*points[:index], moved, *points[index + 1 :])
