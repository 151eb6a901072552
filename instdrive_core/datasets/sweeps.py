"""LiDAR points for any time step, also for those without a sweep of their own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Sweep, SweepPoints
from instdrive_core.scene.box_search import find_box_of_points
from instdrive_core.scene.track import Track, interpolate_tracks

BOX_MARGIN = 0.1
"""Metres by which a moving box is grown to catch its points."""
BOX_BOTTOM = -0.1
"""Margin of the lower face: cuts the road off."""
SIBLING_REACH = 1.0
"""Metres around a moving box within which the second LiDAR, which meets objects at another time, may see the object."""


class SweepCache:
    """The sweeps of a clip that may be used, the last few kept in memory.

    Args:
        clip: the clip.
        held_out: whether sweeps of held-out time steps may be used; False for everything that trains.
    """

    def __init__(self, clip: Clip, held_out: bool = False) -> None:
        self.clip = clip
        self.sweeps = clip.sweeps if held_out else clip.training_sweeps
        self._load_sweep = lru_cache(maxsize=3)(lambda position: self.sweeps[position].load())
        self._last: tuple[int, SweepPoints | None] | None = None
        self._times = {frame.view.index: frame.view.time for frame in clip.frames}

    def load(self, index: int) -> SweepPoints | None:
        """Load the points as they lie at a time step of the clip's frames; None where no sweep may be used.

        The step's own sweep if there is one, else the nearest before and after together, with the points inside boxes
        of moving tracks carried along. Points on objects whose track does not cover the asked time are left out, and
        so are the second LiDAR's on moving objects, which it meets elsewhere than the track says.

        The last result is kept, as all cameras of a step ask for the same points; do not write into it.
        """
        last = self._last
        if last is None or last[0] != index:
            last = self._last = (index, self._load_at(index))
        return last[1]

    def _load_at(self, index: int) -> SweepPoints | None:
        positions = self._find_neighbours(index)
        if not positions:
            return None
        if self.sweeps[positions[0]].index == index:
            return self._load_sweep(positions[0])
        time = self._times[index]
        return _join_sweeps([self._carry_points(position, time) for position in positions])

    def load_positions(self, index: int) -> Float32[ndarray, "n 3"]:
        """Load the positions alone; no rows where no sweep may be used."""
        found = self.load(index)
        return np.zeros((0, 3), np.float32) if found is None else found.points

    def _find_neighbours(self, index: int) -> list[int]:
        """Find positions in `sweeps`: the step's own, else the nearest before and after."""
        indices = [sweep.index for sweep in self.sweeps]
        if index in indices:
            return [indices.index(index)]
        before = [position for position, found in enumerate(indices) if found < index]
        after = [position for position, found in enumerate(indices) if found > index]
        return before[-1:] + after[:1]

    def _carry_points(self, position: int, time: float) -> SweepPoints:
        sweep: Sweep = self.sweeps[position]
        found = self._load_sweep(position)
        tracks = [track for track in self.clip.tracks if track.moving and track.covers(sweep.time)]
        boxes = _Boxes.build(tracks, sweep.time)
        points, kept = found.points.copy(), np.ones(len(found.points), bool)
        near = np.flatnonzero(boxes.find_holders(found.points, SIBLING_REACH) >= 0)
        kept[near[found.sensor[near] != 0]] = False
        stays = np.array([track.covers(time) for track in tracks], bool)
        kept[near[boxes.select(~stays).find_holders(found.points[near], BOX_MARGIN) >= 0]] = False
        carrying = boxes.select(stays)
        holder = carrying.find_holders(found.points[near], BOX_MARGIN)
        for number in np.unique(holder[holder >= 0]):
            motion = carrying.tracks[number].interpolate_pose(time) @ np.linalg.inv(carrying.poses[number])
            rows = near[holder == number]
            points[rows] = found.points[rows] @ motion[:3, :3].T + motion[:3, 3]
        return _select_rows(replace(found, points=points), kept)


@dataclass(frozen=True)
class _Boxes:
    """Moving boxes at one time."""

    tracks: list[Track]
    poses: Float64[ndarray, "b 4 4"]

    @staticmethod
    def build(tracks: list[Track], time: float) -> _Boxes:
        return _Boxes(tracks, interpolate_tracks(tracks, time))

    def select(self, chosen: Bool[ndarray, " b"]) -> _Boxes:
        return _Boxes([self.tracks[number] for number in np.flatnonzero(chosen)], self.poses[chosen])

    def find_holders(self, points: Float32[ndarray, "n 3"], margin: float) -> Int32[ndarray, " n"]:
        """Find the box, grown by `margin` metres, that holds each point; -1 = none."""
        dimensions = np.array([track.dimensions for track in self.tracks]).reshape(-1, 3)
        return find_box_of_points(points, self.poses, dimensions, margin, BOX_BOTTOM)


def _select_rows(sweep: SweepPoints, kept: Bool[ndarray, " n"]) -> SweepPoints:
    return SweepPoints(
        sweep.points[kept],
        sweep.intensity[kept],
        sweep.sensor[kept],
        None if sweep.classes is None else sweep.classes[kept],
        None if sweep.instance_labels is None else sweep.instance_labels[kept],
    )


def _join_sweeps(parts: list[SweepPoints]) -> SweepPoints:
    """Join all points; classes and instances stay only where every part has them."""
    classes = [part.classes for part in parts if part.classes is not None]
    labels = [part.instance_labels for part in parts if part.instance_labels is not None]
    return SweepPoints(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.intensity for part in parts]),
        np.concatenate([part.sensor for part in parts]),
        np.concatenate(classes) if len(classes) == len(parts) else None,
        np.concatenate(labels) if len(labels) == len(parts) else None,
    )
