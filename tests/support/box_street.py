"""A street of boxes met by a spinning LiDAR: walls, parked cars, and cars whose motion is given exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from instdrive_core.datasets.clip import Clip, Frame, Sweep, SweepPoints, is_held_out
from instdrive_core.scene.camera import Camera, CameraView

CAR = (1.9, 4.6, 1.5)
"""Width, length, height in metres."""
LIDAR_HEIGHT = 1.8
BEAMS = np.linspace(-24, 8, 40)
"""Elevations in degrees of the usual beams."""
NOISE = 0.02
JAM_SECONDS = 4.0
Way = Callable[[float], float]


@dataclass(frozen=True)
class Body:
    """A box on the ground."""

    pose: Callable[[float], tuple[float, float, float]]
    """x, y of its centre and heading (radians, 0 = along x) by time."""
    size: tuple[float, float, float] = CAR


def standing(x: float, y: float, yaw: float = 0.0, size: tuple[float, float, float] = CAR) -> Body:
    """A box that stays."""
    return Body(lambda time: (x, y, yaw), size)


def walls() -> list[Body]:
    """Houses along both sides, with gaps, and parked cars before them."""
    houses = [standing(x, side * 12, 0, (4.0, 14.0, 8.0)) for x in range(-50, 110, 20) for side in (1, -1)]
    return houses + [standing(x, -5.5) for x in range(-20, 60, 13)]


def box_clip(
    bodies: list[Body],
    steps: int = 20,
    period: float = 0.1,
    ego: Callable[[float], float] = lambda time: 0.0,
    timed: bool = True,
    beams: int = len(BEAMS),
    azimuths: int = 720,
) -> Clip:
    """A clip of sweeps only: the ego car is at `ego(time)` along x; with `timed` points carry their times."""
    sweeps, frames = [], []
    for step in range(steps):
        time = step * period
        sweep = _sweep(bodies, time, period if timed else 0.0, ego, beams, azimuths, step)
        sweeps.append(Sweep(step, time, lambda sweep=sweep: sweep))
        pose = np.eye(4)
        pose[:3, 3] = ego(time), 0.0, LIDAR_HEIGHT
        camera = Camera(50.0, 50.0, 32.0, 18.0, 64, 36, pose)
        view = CameraView(camera, "front_camera", step, time, "", is_held_out(step))
        frames.append(Frame(view, lambda: np.zeros((36, 64, 3), np.uint8)))
    return Clip("boxes", "boxes", np.zeros(3), tuple(frames), tuple(sweeps), (), {}, ("front_camera",))


def _sweep(bodies, time, turn, ego, beams, azimuths, seed):
    elevation = np.radians(np.linspace(BEAMS[0], BEAMS[-1], beams))
    azimuth = np.linspace(0, 2 * np.pi, azimuths, endpoint=False)
    times = np.repeat(time + turn * (azimuth / (2 * np.pi) - 0.5), beams)
    elevation, azimuth = np.tile(elevation, azimuths), np.repeat(azimuth, beams)
    directions = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    along = np.repeat([ego(moment) for moment in times[::beams]], beams)
    origins = np.stack([along, np.zeros(len(times)), np.full(len(times), LIDAR_HEIGHT)], 1)
    moments, which = np.unique(times, return_inverse=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = np.where(directions[:, 2] < 0, -LIDAR_HEIGHT / directions[:, 2], np.inf)
        for body in bodies:
            ranges = np.minimum(ranges, _met(body, origins, directions, moments, which))
    rng = np.random.default_rng(seed)
    kept = np.isfinite(ranges) & (ranges > 1.5) & (ranges < 100)
    points = origins[kept] + (ranges[kept] + NOISE * rng.standard_normal(kept.sum()))[:, None] * directions[kept]
    count = len(points)
    zeros = np.zeros(count, np.uint8)
    return SweepPoints(
        points.astype(np.float32), np.zeros(count, np.float32), zeros, None, None, times[kept] if turn else None
    )


def _met(body, origins, directions, moments, which):
    """Distance along each ray to a body, infinity where it passes; ray i leaves at ``moments[which[i]]``."""
    poses = np.array([body.pose(moment) for moment in moments])
    cosine, sine = np.cos(poses[:, 2])[which], np.sin(poses[:, 2])[which]
    width, length, height = body.size
    middle = (*poses[which, :2].T, 0.15 + height / 2)
    x, y, z = (column - at for column, at in zip(origins.T, middle, strict=True))
    along, across, up = directions.T
    start = (cosine * x + sine * y, cosine * y - sine * x, z)
    way = (cosine * along + sine * across, cosine * across - sine * along, up)
    near, far = np.full(len(which), -np.inf), np.full(len(which), np.inf)
    for begin, step, half in zip(start, way, (length / 2, width / 2, height / 2), strict=True):
        first, second = (-half - begin) / step, (half - begin) / step
        near, far = np.maximum(near, np.minimum(first, second)), np.minimum(far, np.maximum(first, second))
    return np.where((near < far) & (near > 0), near, np.inf)


def drive_by_speeds(times: list[float], speeds: list[float]) -> Way:
    """Metres travelled by time, speeds going straight from one to the next."""
    fine = np.arange(-0.2, JAM_SECONDS + 0.4, 0.02)
    now = np.interp(fine, times, speeds)
    travelled = np.concatenate([[0.0], np.cumsum((now[1:] + now[:-1]) * 0.01)])
    travelled -= np.interp(0.0, fine, travelled)
    return lambda time: float(np.interp(time, fine, travelled))


def along_lane(x: float, y: float, way: Way) -> Body:
    """A car in a lane."""
    return Body(lambda time: (x + way(time), y, 0.0))


def jam() -> tuple[Clip, dict[str, Body]]:
    """A jam on three lanes, and what moves in it: cars that creep, stop and creep on, one beside the recording car, and
    one that leaves its parking space."""
    ego = drive_by_speeds([0, 0.8, 1.6, 2.2, 3.0, 4.0], [1.2, 1.4, 0.6, 0.5, 1.3, 1.5])
    ways = {
        "ahead": (9.0, 0.0, drive_by_speeds([0, 0.7, 1.3, 2.0, 2.8, 4.0], [1.3, 1.4, 0.2, 0.0, 1.2, 1.5])),
        "left": (6.0, 3.4, drive_by_speeds([0, 0.6, 1.2, 2.0, 2.6, 4.0], [0.0, 0.9, 1.5, 1.4, 0.3, 1.0])),
        "beside": (1.0, -3.4, drive_by_speeds([0, 0.8, 1.6, 2.4, 3.2, 4.0], [1.3, 1.5, 0.7, 0.5, 1.3, 1.4])),
        "drives off": (14.0, -6.4, drive_by_speeds([0, 1.6, 3.2, 4.0], [0.0, 0.0, 3.0, 3.5])),
    }
    bodies = {name: along_lane(*way) for name, way in ways.items()}
    houses = [standing(x, side * 14, 0, (4.0, 14.0, 8.0)) for x in range(-20, 50, 20) for side in (1, -1)]
    parked = [standing(x, -6.4) for x in (-4, 8, 20)]
    steps = round(JAM_SECONDS / 0.1)
    return box_clip([*houses, *parked, *bodies.values()], steps, 0.1, ego, beams=28, azimuths=540), bodies
