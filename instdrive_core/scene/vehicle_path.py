"""The way of a vehicle: keys on the ground with times, and templates that change a way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.track import Track

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

_SLOW = 0.3
"""m/s below which a vehicle keeps its heading."""
STEP = 0.5
"""Seconds between the keys that templates make."""
LANE_SECONDS, BRAKE_SECONDS = 3.0, 2.0
"""How long a change of lane and braking to a stop take."""


@dataclass(frozen=True)
class PathKey:
    """Where the middle of the vehicle is at a time."""

    time: float
    """Seconds as the scene counts them."""
    x: float
    y: float
    """Metres in the scene."""
    heading: float | None = None
    """Radians counter-clockwise from x; None: along the way."""


@dataclass(frozen=True)
class PathSamples:
    """A way, sampled."""

    times: Float64[ndarray, " n"]
    places: Float64[ndarray, "n 2"]
    """Metres."""
    headings: Float64[ndarray, " n"]
    """Radians."""


def sample_path(keys: Sequence[PathKey], times: Float64[ndarray, " n"], start_heading: float = 0.0) -> PathSamples:
    """Sample a way at times; before its first and after its last key the vehicle stands there.

    Between keys x and y follow monotone cubics (Fritsch and Carlson 1980): smooth, and never past a key at which the
    vehicle turns back or stands. It heads where it goes, and keeps its heading while it stands; keys' own headings
    win where all keys have one.

    Args:
        keys: at least one, times rising.
        times: seconds.
        start_heading: radians, for a vehicle that never moves.
    """
    at = np.array([key.time for key in keys])
    marks = np.array([(key.x, key.y) for key in keys], np.float64)
    inside = np.clip(times, at[0], at[-1])
    if len(keys) == 1:
        heading = start_heading if keys[0].heading is None else keys[0].heading
        return PathSamples(times, np.repeat(marks, len(times), 0), np.full(len(times), heading))
    from scipy.interpolate import PchipInterpolator  # a quarter second, which the editor would start later

    curve = PchipInterpolator(at, marks, axis=0)
    places = np.asarray(curve(inside), np.float64)
    own = [key.heading for key in keys if key.heading is not None]
    if len(own) == len(keys):
        return PathSamples(times, places, np.asarray(PchipInterpolator(at, np.unwrap(own))(inside)))
    return PathSamples(times, places, _find_headings(curve, inside, start_heading))


def _find_headings(curve: PchipInterpolator, times: Float64[ndarray, " n"], start: float) -> Float64[ndarray, " n"]:
    """Direction of the way where the vehicle moves, that of the nearest moment before (else after) where it stands."""
    fine = np.unique(np.r_[times, np.linspace(curve.x[0], curve.x[-1], 20 * len(curve.x))])
    velocity = np.asarray(curve(fine, 1))
    moves = np.flatnonzero(np.hypot(velocity[:, 0], velocity[:, 1]) > _SLOW)
    if not len(moves):
        return np.full(len(times), start)
    headings = np.unwrap(np.arctan2(velocity[moves, 1], velocity[moves, 0]))
    rows = np.searchsorted(fine[moves], times, side="right") - 1
    return headings[np.maximum(rows, 0)]


def change_lane(keys: Sequence[PathKey], offset: float, start: float) -> tuple[PathKey, ...]:
    """Change to a lane `offset` metres to the left (negative: right) from `start` seconds on.

    It takes `LANE_SECONDS`; a way that ends earlier ends between the lanes.
    """
    sampled = _sample_evenly(keys, (start, start + LANE_SECONDS))
    share = np.clip((sampled.times - start) / LANE_SECONDS, 0, 1)
    aside = offset * share * share * (3 - 2 * share)
    left = np.stack([-np.sin(sampled.headings), np.cos(sampled.headings)], axis=1)
    return _make_keys(sampled.times, sampled.places + aside[:, None] * left)


def stop_at(keys: Sequence[PathKey], start: float) -> tuple[PathKey, ...]:
    """Brake evenly from `start` seconds on and stand `BRAKE_SECONDS` later, on the same way."""

    def spend(late: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
        braking = np.minimum(late, BRAKE_SECONDS)
        return braking * (1 - braking / (2 * BRAKE_SECONDS))

    return _retime(keys, start, spend)


def change_speed(keys: Sequence[PathKey], factor: float, start: float = -math.inf) -> tuple[PathKey, ...]:
    """Drive the same way `factor` times as fast from `start` seconds on; the way ends where it did."""
    return _retime(keys, max(start, keys[0].time), lambda late: factor * late)


def wait_at(keys: Sequence[PathKey], seconds: float, start: float) -> tuple[PathKey, ...]:
    """Brake from `start` seconds on, stand for `seconds`, and drive on the same way; it ends when it did."""

    def spend(late: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
        braking = np.minimum(late, BRAKE_SECONDS)
        return braking * (1 - braking / (2 * BRAKE_SECONDS)) + _start_off(late - BRAKE_SECONDS - seconds)

    return _retime(keys, start, spend)


def start_at(keys: Sequence[PathKey], start: float) -> tuple[PathKey, ...]:
    """Stand where the way begins until `start` seconds, then drive it; it ends when it did."""
    first = keys[0].time
    return _retime(keys, first, lambda late: _start_off(late - (start - first)))


def _start_off(late: Float64[ndarray, " n"]) -> Float64[ndarray, " n"]:
    """Seconds of the way that are driven within so many seconds of starting off; as long as braking takes."""
    speeding = np.clip(late, 0, BRAKE_SECONDS)
    return speeding**2 / (2 * BRAKE_SECONDS) + np.maximum(late - BRAKE_SECONDS, 0)


def turn_off(keys: Sequence[PathKey], angle: float, start: float, radius: float = 10.0) -> tuple[PathKey, ...]:
    """Leave the way at `start` seconds on a bend of `radius` metres by `angle` radians (left above 0), then go on.

    The speed stays what it is then, but is at least 2 m/s, and no more than what gives 3 m/s² across in the bend.
    """
    end = max(keys[-1].time, start + STEP)
    before = _sample_evenly(keys, (start,))
    kept = before.times <= start
    here = sample_path(keys, np.array([start - 0.05, start, start + 0.05]))
    speed = float(np.linalg.norm(here.places[2] - here.places[0])) / 0.1
    speed = min(max(speed, 2.0), math.sqrt(3.0 * radius))
    heading, place = float(here.headings[1]), here.places[1]
    times = np.arange(start + STEP, end + STEP / 2, STEP)
    gone = speed * (times - start)
    bent = np.minimum(gone / radius, abs(angle)) * math.copysign(1, angle)
    center = place + radius * math.copysign(1, angle) * np.array([-math.sin(heading), math.cos(heading)])
    arms = math.copysign(radius, angle) * np.stack([np.sin(heading + bent), -np.cos(heading + bent)], axis=1)
    straight = np.maximum(gone - radius * abs(angle), 0)
    ahead = np.stack([np.cos(heading + bent), np.sin(heading + bent)], axis=1)
    places = center + arms + straight[:, None] * ahead
    return _make_keys(np.r_[before.times[kept], times], np.r_[before.places[kept], places])


def _retime(
    keys: Sequence[PathKey], start: float, spent: Callable[[Float64[ndarray, " n"]], Float64[ndarray, " n"]]
) -> tuple[PathKey, ...]:
    """Keys at even times whose places are those of `start + spent(t - start)` from `start` on."""
    sampled = _sample_evenly(keys, (start,))
    late = np.maximum(sampled.times - start, 0)
    source = np.where(sampled.times <= start, sampled.times, start + spent(late))
    return _make_keys(sampled.times, sample_path(keys, source).places)


def _sample_evenly(keys: Sequence[PathKey], extra: Sequence[float]) -> PathSamples:
    first, last = keys[0].time, keys[-1].time
    steps = max(1, round((last - first) / STEP))
    inside = [time for time in extra if first <= time <= last]
    return sample_path(keys, np.unique(np.r_[np.linspace(first, last, steps + 1), inside]))


def _make_keys(times: ndarray, places: ndarray) -> tuple[PathKey, ...]:
    keep = np.r_[True, np.diff(times) > 1e-3]
    rows = zip(times[keep].tolist(), places[keep].tolist(), strict=True)
    return tuple(PathKey(time, x, y) for time, (x, y) in rows)


def trace_way(track: Track) -> tuple[PathKey, ...]:
    """Trace the way of a track: a key every `STEP` seconds."""
    steps = max(1, round(float(track.times[-1] - track.times[0]) / STEP))
    times = np.unique(np.linspace(track.times[0], track.times[-1], steps + 1))
    places = track.interpolate_poses(times)[:, :2, 3]
    return _make_keys(times, places)


def describe_way(keys: Sequence[PathKey]) -> tuple[tuple[float, ...], ...]:
    """Describe keys as edits hold them: (time, x, y) or (time, x, y, heading) each."""
    return tuple(
        (key.time, key.x, key.y) if key.heading is None else (key.time, key.x, key.y, key.heading) for key in keys
    )
