"""LiDAR points for any time step, also for those without a sweep of their own."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Sweep, SweepPoints
from instdrive_core.scene.track import points_inside

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
        self.sweeps = clip.sweeps if held_out else clip.training_sweeps()
        self._load = lru_cache(maxsize=3)(lambda position: self.sweeps[position].load())
        self._times = {frame.view.index: frame.view.time for frame in clip.frames}

    def at(self, index: int) -> SweepPoints | None:
        """Points as they lie at a time step of the clip's frames; None where no sweep may be used.

        The step's own sweep if there is one, else the nearest before and after together, with the points inside boxes
        of moving tracks carried along. Points on objects whose track does not cover the asked time are left out, and
        so are the second LiDAR's on moving objects, which it meets elsewhere than the track says.
        """
        positions = self._neighbours(index)
        if not positions:
            return None
        if self.sweeps[positions[0]].index == index:
            return self._load(positions[0])
        time = self._times[index]
        return _joined([self._carried(position, time) for position in positions])

    def points_at(self, index: int) -> Float32[ndarray, "n 3"]:
        """Positions only; none where no sweep may be used."""
        found = self.at(index)
        return np.zeros((0, 3), np.float32) if found is None else found.points

    def _neighbours(self, index: int) -> list[int]:
        """Positions in `sweeps`: the step's own, else the nearest before and after."""
        indices = [sweep.index for sweep in self.sweeps]
        if index in indices:
            return [indices.index(index)]
        before = [position for position, found in enumerate(indices) if found < index]
        after = [position for position, found in enumerate(indices) if found > index]
        return before[-1:] + after[:1]

    def _carried(self, position: int, time: float) -> SweepPoints:
        sweep: Sweep = self.sweeps[position]
        found = self._load(position)
        points, kept = found.points.copy(), np.ones(len(found.points), bool)
        for track in self.clip.tracks:
            if not track.moving or not track.covers(sweep.time):
                continue
            pose = track.pose_at(sweep.time)
            near = _near(found.points, pose, track.dimensions)
            around = near[points_inside(found.points[near], pose, track.dimensions, SIBLING_REACH, BOX_BOTTOM)]
            kept[around[found.sensor[around] != 0]] = False
            inside = near[points_inside(found.points[near], pose, track.dimensions, BOX_MARGIN, BOX_BOTTOM)]
            if track.covers(time):
                motion = track.pose_at(time) @ np.linalg.inv(pose)
                points[inside] = found.points[inside] @ motion[:3, :3].T + motion[:3, 3]
            else:
                kept[inside] = False
        return _taken(replace(found, points=points), kept)


def sweep_points_at(clip: Clip, index: int, held_out: bool = False) -> SweepPoints | None:
    """Points as they lie at a time step; see `SweepCache.at`, which is better for several steps.

    Args:
        clip: the clip.
        index: a time step of the clip's frames.
        held_out: whether sweeps of held-out time steps may be used; False for everything that trains.
    """
    return SweepCache(clip, held_out).at(index)


def _near(points: Float32[ndarray, "n 3"], pose: ndarray, dimensions: ndarray) -> ndarray:
    """Rows within a box's reach in x and y: a cheap test before the exact one."""
    reach = float(np.linalg.norm(dimensions)) / 2 + 2 * SIBLING_REACH
    offset = np.abs(points[:, :2] - pose[:2, 3].astype(np.float32))
    return np.flatnonzero((offset[:, 0] < reach) & (offset[:, 1] < reach))


def _taken(sweep: SweepPoints, kept: Bool[ndarray, " n"]) -> SweepPoints:
    return SweepPoints(
        sweep.points[kept],
        sweep.intensity[kept],
        sweep.sensor[kept],
        None if sweep.classes is None else sweep.classes[kept],
        None if sweep.instance_labels is None else sweep.instance_labels[kept],
    )


def _joined(parts: list[SweepPoints]) -> SweepPoints:
    """All points; classes and instances only where every part has them."""
    classes = [part.classes for part in parts if part.classes is not None]
    labels = [part.instance_labels for part in parts if part.instance_labels is not None]
    return SweepPoints(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.intensity for part in parts]),
        np.concatenate([part.sensor for part in parts]),
        np.concatenate(classes) if len(classes) == len(parts) else None,
        np.concatenate(labels) if len(labels) == len(parts) else None,
    )
