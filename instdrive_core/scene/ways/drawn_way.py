"""A way that is drawn on the ground: places in order, driven at a speed, as fast as a drive, or at given times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_number
from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import PathKey, sample_path

MOST_PLACES = 10_000
FASTEST = 100.0
"""m/s that a drawn way may be driven at."""
_FINE = 0.1
"""Metres between the places by which the length of a way is added up."""
_EVEN = 0.1
"""Seconds between the keys of a way that is driven at a speed."""
_LEAST = 0.01
"""Metres between two places that follow each other, at least."""


@dataclass(frozen=True)
class DrawnWay:
    """At least two places, and how they are driven."""

    places: tuple[tuple[float, float], ...]
    """x and y in the scene, metres."""
    speed: float | None = None
    """m/s; None: as fast as the recorded drive, or at the given times."""
    times: tuple[float, ...] = ()
    """Seconds as the scene counts them, one a place; empty: the speed says when it is where."""
    headings: tuple[float, ...] = ()
    """Radians counter-clockwise from x, one a place that has a time; empty: along the way."""
    in_world: bool = False
    """Whether places are in the data set's world: the scene's origin is still to be taken off."""

    def place_in_scene(self, origin: Float64[ndarray, "3"]) -> DrawnWay:
        """Take a scene's origin (metres) off places that are in the world; others stay."""
        if not self.in_world:
            return self
        moved = tuple((x - float(origin[0]), y - float(origin[1])) for x, y in self.places)
        return replace(self, places=moved, in_world=False)


def time_way(drawn: DrawnWay, recorded: Track) -> tuple[PathKey, ...]:
    """Find when a drawn way is where: keys close together in time.

    Without times of its own it begins when the recorded drive begins, and stands at its end if that comes early.
    """
    if drawn.times:
        headings = drawn.headings or (None,) * len(drawn.times)
        keys = zip(drawn.times, drawn.places, headings, strict=True)
        return tuple(PathKey(time, x, y, heading) for time, (x, y), heading in keys)
    places, lengths = trace_line(drawn.places)
    first, last = float(recorded.times[0]), float(recorded.times[-1])
    times = np.linspace(first, last, max(2, round((last - first) / _EVEN) + 1))
    if drawn.speed is None:
        steps = np.linalg.norm(np.diff(recorded.world_from_box[:, :3, 3], axis=0), axis=1)
        gone = np.interp(times, recorded.times, np.r_[0.0, np.cumsum(steps)])
    else:
        gone = drawn.speed * (times - first)
    gone = np.minimum(gone, lengths[-1])
    there = np.stack([np.interp(gone, lengths, places[:, axis]) for axis in (0, 1)], axis=1)
    return tuple(PathKey(time, x, y) for time, (x, y) in zip(times.tolist(), there.tolist(), strict=True))


def trace_line(places: Sequence[tuple[float, float]]) -> tuple[Float64[ndarray, "n 2"], Float64[ndarray, " n"]]:
    """Trace the smooth line through places (metres); returns points close together, and the way up to each."""
    marks = np.array(places, np.float64)
    apart = np.r_[0.0, np.cumsum(np.maximum(np.linalg.norm(np.diff(marks, axis=0), axis=1), _LEAST))]
    keys = tuple(PathKey(at, x, y) for at, (x, y) in zip(apart.tolist(), marks.tolist(), strict=True))
    line = sample_path(keys, np.linspace(0.0, apart[-1], max(2, int(apart[-1] / _FINE) + 1))).places
    return line, np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))]


def read_drawn_way(file: Path) -> DrawnWay:
    """Read a way: an object with `keys`, each with `x` and `y`, all of them or none with `time`; and if wanted `speed`.

    Raises DataError naming the field that is wrong.
    """
    whole = read_json(file)
    keys = require_field(file, whole, "keys")
    if not isinstance(keys, list) or not 2 <= len(keys) <= MOST_PLACES:
        raise DataError(
            file, "the field 'keys' holds no way", f"Write a list of 2 to {MOST_PLACES} objects with x and y, in metres"
        )
    places, times = [], []
    for number, entry in enumerate(keys):
        where = f"keys[{number}]."
        x, y = (require_number(file, require_field(file, entry, name, where), f"{where}{name}") for name in ("x", "y"))
        places.append((x, y))
        if "time" in entry:
            times.append(require_number(file, entry["time"], f"{where}time"))
    speed = whole.get("speed")
    speed = None if speed is None else require_number(file, speed, "speed")
    if speed is not None and not 0 < speed <= FASTEST:
        raise DataError(file, f"the field 'speed' is {speed:g}", f"Write m/s above 0 and up to {FASTEST:g}")
    if times and len(times) != len(places):
        raise DataError(file, "only some of the 'keys' have a field 'time'", "Give all of them a time, or none")
    if times and speed is not None:
        raise DataError(file, "the field 'speed' does not go with times of the 'keys'", "Take one of them out")
    for number in range(1, len(times)):
        if times[number] <= times[number - 1]:
            raise DataError(file, f"the field 'keys[{number}].time' is not above the one before", "Sort the keys")
    return DrawnWay(tuple(places), speed, tuple(times))


def describe_drawn_way(drawn: DrawnWay) -> dict[str, Any]:
    """Describe a way as JSON values that `read_drawn_way` reads."""
    keys: list[dict[str, float]] = [{"x": x, "y": y} for x, y in drawn.places]
    for key, time in zip(keys, drawn.times, strict=False):
        key["time"] = time
    return {"keys": keys} if drawn.speed is None else {"keys": keys, "speed": drawn.speed}
