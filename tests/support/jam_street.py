"""A jam on three lanes: cars that creep, stop and creep on, one beside the recording car, and one that leaves its
parking space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from box_street import Body, box_clip, standing

from instdrive_core.datasets.clip import Clip

SECONDS = 4.0
Way = Callable[[float], float]


def drive_by_speeds(times: list[float], speeds: list[float]) -> Way:
    """Metres travelled by time, speeds going straight from one to the next."""
    fine = np.arange(-0.2, SECONDS + 0.4, 0.02)
    now = np.interp(fine, times, speeds)
    travelled = np.concatenate([[0.0], np.cumsum((now[1:] + now[:-1]) * 0.01)])
    travelled -= np.interp(0.0, fine, travelled)
    return lambda time: float(np.interp(time, fine, travelled))


def along_lane(x: float, y: float, way: Way) -> Body:
    """A car in a lane."""
    return Body(lambda time: (x + way(time), y, 0.0))


def jam(seconds: float = SECONDS) -> tuple[Clip, dict[str, Body]]:
    """The clip, with one forward camera, and what moves in it."""
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
    steps = round(seconds / 0.1)
    return box_clip([*houses, *parked, *bodies.values()], steps, 0.1, ego, beams=28, azimuths=540), bodies
