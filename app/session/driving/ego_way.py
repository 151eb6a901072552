"""The way that the user has drawn for the recording car."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.transforms import Similarity
from instdrive_core.scene.ways.drawn_way import DrawnWay, trace_line

MOST = 200
"""Places that a drawn way may have."""
Place = tuple[float, float]


class EgoWay:
    """Places on the ground (metres) in the order of driving; kept by projects, and no edit of the scene."""

    def __init__(self) -> None:
        self._places: tuple[Place, ...] = ()
        self._line: tuple[tuple[Place, ...], Float64[ndarray, "n 2"]] | None = None
        self.is_drawing = False
        """Whether clicks on the map set places."""
        self.version = 0
        """Rises with every change that a project has to hold."""

    @property
    def places(self) -> tuple[Place, ...]:
        """The places."""
        return self._places

    @property
    def is_way(self) -> bool:
        """Whether there are enough places to drive along."""
        return len(self._places) > 1

    def forget(self) -> None:
        """Forget everything, since another document is open."""
        self._places, self.is_drawing, self.version = (), False, 0

    def add(self, x: float, y: float) -> None:
        """Drive on to a place."""
        if len(self._places) < MOST:
            self._set((*self._places, (x, y)))

    def move(self, index: int, x: float, y: float) -> None:
        """Put a place elsewhere."""
        self._set((*self._places[:index], (x, y), *self._places[index + 1 :]))

    def drop_last(self) -> None:
        """Take the last place away."""
        self._set(self._places[:-1])

    def clear(self) -> None:
        """Take all places away."""
        self._set(())

    def toggle_drawing(self) -> None:
        """Begin or end drawing."""
        self.is_drawing = not self.is_drawing

    def find_line(self) -> Float64[ndarray, "n 2"]:
        """Find the smooth line through the places, metres."""
        if not self.is_way:
            return np.array(self._places, np.float64).reshape(-1, 2)
        if self._line is None or self._line[0] != self._places:
            self._line = (self._places, trace_line(self._places)[0])
        return self._line[1]

    def build(self, speed: float | None) -> DrawnWay:
        """Build the way that is driven at a speed (m/s), or None: as fast as the drive was recorded."""
        return DrawnWay(self._places, speed)

    def follow_scene(self, matrix: Similarity) -> None:
        """Stay on the same ground after the whole scene was transformed by [s R | t]."""
        flat = [matrix[:, :3] @ np.array([x, y, 0.0]) + matrix[:, 3] for x, y in self._places]
        self._places = tuple((float(place[0]), float(place[1])) for place in flat)

    def store(self) -> list[list[float]]:
        """Convert the places into JSON values."""
        return [[x, y] for x, y in self._places]

    def restore(self, stored: object) -> None:
        """Take over what `store` gave; nothing where that makes no sense."""
        places = [_read_place(entry) for entry in stored[:MOST]] if isinstance(stored, list) else []
        kept = tuple(place for place in places if place is not None)
        self._places = kept if len(kept) == len(places) else ()

    def _set(self, places: tuple[Place, ...]) -> None:
        if places != self._places:
            self._places, self.version = places, self.version + 1


def _read_place(entry: object) -> Place | None:
    if isinstance(entry, Mapping) or not isinstance(entry, list) or len(entry) != 2:
        return None
    if not all(isinstance(value, int | float) and math.isfinite(value) for value in entry):
        return None
    return float(entry[0]), float(entry[1])
