"""When a turning LiDAR looks in which direction, and how much later photos show what it met there.

The LiDAR takes a tenth of a second for a turn, and cameras fire while it goes round. Its points say when each was
measured: directions against times are a line, and the photos' own times say where on it they were taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Frame, Sweep, SweepPoints, is_held_out
from instdrive_core.errors import DataError
from instdrive_core.scene.camera import Camera, PhotoLag

_NEAREST = 5.0
"""Metres from the car up to which directions say little: where the LiDAR sits is not known well."""
_INSTANTS = 60
"""Parts of the turn whose directions are compared with a line."""
_FEWEST = 20
"""Parts that must have points."""
_GATHERED = 0.9
"""Least length of the mean direction of a part's points: a LiDAR that does not turn looks everywhere at once."""
_STRAY = np.radians(5.0)
"""How far directions may be from the line (median)."""
_WHOLE = 0.15
"""Share by which a sweep may be longer or shorter than a turn."""
_LATEST = 0.5
"""Seconds between a photo and its step from which on its clock is another one."""


@dataclass(frozen=True)
class LaserTurn:
    """One turn of a LiDAR, as seen from the car that carries it."""

    start: float
    """Direction in which it begins, radians counterclockwise from where the first camera looks."""
    turn: float
    """Seconds of a whole turn; negative = clockwise."""
    began: float
    """When it begins, seconds after the time step."""


def add_photo_lags(frames: Sequence[Frame], sweeps: Sequence[Sweep], taken: Mapping[str, float]) -> list[Frame]:
    """Add to photos how much later than the LiDAR they show things (`PhotoLag`), where the sweeps tell.

    Args:
        frames: by time step.
        sweeps: the first that may train speaks for all: LiDARs turn evenly.
        taken: seconds when each photo was taken, by the frame's key, as the clip counts them.
    """
    frames = list(frames)
    found = _find_turn(frames, sweeps)
    if found is None:
        return frames
    turn, first = found
    lagging: list[Frame] = []
    for _, step in groupby(frames, key=lambda frame: frame.view.index):
        of_step = list(step)
        cameras = {frame.view.name: frame.view.camera for frame in of_step}
        if first not in cameras:
            lagging += of_step
            continue
        center, heading = _find_car(cameras, first)
        lagging += [_delay(frame, turn, center, heading, taken.get(frame.key)) for frame in of_step]
    return lagging


def _find_turn(frames: Sequence[Frame], sweeps: Sequence[Sweep]) -> tuple[LaserTurn, str] | None:
    """The turn, and the camera from whose direction it counts."""
    for sweep in sweeps:
        cameras = {frame.view.name: frame.view.camera for frame in frames if frame.view.index == sweep.index}
        if is_held_out(sweep.index) or not cameras:
            continue
        try:
            points = sweep.load()
        except DataError:  # whoever needs its points says so
            continue
        first = next(iter(cameras))
        turn = measure_turn(points, sweep.time, *_find_car(cameras, first))
        return None if turn is None else (turn, first)
    return None


def measure_turn(sweep: SweepPoints, time: float, center: Float64[ndarray, "3"], heading: float) -> LaserTurn | None:
    """Measure a turn of the spinning LiDAR; None where the points do not tell when they were measured, or none turns.

    Args:
        sweep: its points.
        time: that of its step (seconds).
        center: where the LiDAR stands, roughly (metres).
        heading: where the car looks, radians counterclockwise from x.
    """
    if sweep.times is None:
        return None
    away = sweep.points[:, :2] - center[:2]
    rows = np.flatnonzero((sweep.sensor == 0) & (np.hypot(*away.T) > _NEAREST))
    times = sweep.times[rows]
    if not len(rows) or np.ptp(times) <= 0 or np.abs(times - time).max() > _LATEST:
        return None
    first, span = float(times.min()), float(np.ptp(times))
    part = np.minimum(((times - first) / span * _INSTANTS).astype(int), _INSTANTS - 1)
    directions = np.exp(1j * np.arctan2(away[rows, 1], away[rows, 0]))
    counts = np.bincount(part, minlength=_INSTANTS)
    sums = np.bincount(part, directions.real, _INSTANTS) + 1j * np.bincount(part, directions.imag, _INSTANTS)
    known = np.flatnonzero(counts)
    means = sums[known] / counts[known]
    if len(known) < _FEWEST or np.median(np.abs(means)) < _GATHERED:
        return None
    angles, instants = np.unwrap(np.angle(means)), (known + 0.5) / _INSTANTS * span
    rate, start = np.polyfit(instants, angles, 1)
    stray = np.median(np.abs(angles - rate * instants - start))
    if stray > _STRAY or abs(abs(rate) * span / (2 * np.pi) - 1) > _WHOLE:
        return None
    return LaserTurn(float(start - heading), float(2 * np.pi / rate), first - time)


def _find_car(cameras: Mapping[str, Camera], first: str) -> tuple[Float64[ndarray, "3"], float]:
    """Where the car is, amid its cameras, and where the first one looks."""
    forward = cameras[first].world_from_camera[:2, 2]
    center = np.mean([camera.position for camera in cameras.values()], axis=0)
    return center, float(np.arctan2(forward[1], forward[0]))


def _delay(frame: Frame, turn: LaserTurn, center: Float64[ndarray, "3"], heading: float, taken: float | None) -> Frame:
    view = frame.view
    if taken is None or abs(taken - view.time) > _LATEST:
        return frame
    lag = PhotoLag.look_from(center, turn.start + heading, turn.turn, turn.began, taken - view.time)
    return replace(frame, view=replace(view, camera=replace(view.camera, lag=lag)))
