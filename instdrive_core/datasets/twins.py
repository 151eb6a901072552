"""Tracks that are one object: two boxes of like size that lie in each other all the way.

Where two LiDARs see an object that moves, some data sets annotate it twice, each time where that LiDAR met it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.track import Track

CLOSE = 1 / 3
"""Share of the longer side within which the centres of twins lie."""
MOST = 0.6
"""Share of their shared steps in which they do."""
MIN_SHARED = 2
"""Steps that two tracks must share to be compared."""
LIKE_SIZE = 0.7
"""Ratio of the smaller to the larger of two like lengths."""
LIKE_AXES = (1, 0)
"""Length and width; height says little, as the ground hides it."""
SAME_TIME = 1e-3
"""Seconds within which two moments are one step."""


@dataclass(frozen=True)
class TwinMerge:
    """Tracks of which each object is there once."""

    tracks: tuple[Track, ...]
    merged: dict[str, tuple[str, ...]]
    """ID of each kept track that stands for several, with the IDs that went up in it."""

    def note(self) -> str | None:
        """What a user should know; None where nothing was merged."""
        if not self.merged:
            return None
        pairs = [f"{kept[:8]} with {', '.join(one[:8] for one in gone)}" for kept, gone in sorted(self.merged.items())]
        shown = "; ".join(pairs[:5]) + (f"; and {len(pairs) - 5} more" if len(pairs) > 5 else "")
        count = sum(len(gone) for gone in self.merged.values())
        what = "a track lies" if count == 1 else f"{count} tracks lie"
        return f"{what} in the box of another all the way and went up in it, as one object: {shown}"


def merge_twins(tracks: tuple[Track, ...], rank: Callable[[Track], Any] = lambda track: 0) -> TwinMerge:
    """Merge tracks that are one object.

    In each step the pose of the track that comes first by `rank` is kept; among equals that of the longer one, then of
    the first by ID. The kept track has that one's ID and label, and the size of the longest.

    Args:
        tracks: in any order.
        rank: smaller for tracks nearer in time to the cameras' exposure, e.g. 0 for the spinning LiDAR's.
    """
    order = sorted(tracks, key=lambda track: (rank(track), -len(track.times), track.id))
    groups: list[list[Track]] = []
    for track in order:
        twin = next((group for group in groups if any(are_twins(track, one) for one in group)), None)
        if twin is None:
            groups.append([track])
        else:
            twin.append(track)
    kept = {group[0].id: _join_twins(group) if len(group) > 1 else group[0] for group in groups}
    return TwinMerge(
        tuple(kept[track.id] for track in tracks if track.id in kept),
        {group[0].id: tuple(one.id for one in group[1:]) for group in groups if len(group) > 1},
    )


def are_twins(first: Track, second: Track) -> bool:
    """Whether two tracks are of like size, and in most of their shared steps their centres lie within a third of the
    longer side."""
    sizes = first.dimensions, second.dimensions
    for axis in LIKE_AXES:
        small, large = sorted((sizes[0][axis], sizes[1][axis]))
        if small < LIKE_SIZE * large and large - small > 0.3:
            return False
    offsets = compute_shared_offsets(first, second)
    if len(offsets) < min(MIN_SHARED, len(first.times), len(second.times)):
        return False
    reach = CLOSE * max(sizes[0][:2].max(), sizes[1][:2].max())
    close = np.linalg.norm(offsets[:, :2], axis=1) < reach
    level = np.abs(offsets[:, 2]) < (sizes[0][2] + sizes[1][2]) / 2
    return bool((close & level).mean() > MOST)


def compute_shared_offsets(first: Track, second: Track) -> Float64[ndarray, "s 3"]:
    """Metres from the first to the second centre in each step that both have."""
    near = np.abs(first.times[:, None] - second.times[None]) < SAME_TIME
    rows, columns = np.nonzero(near)
    return second.world_from_box[columns, :3, 3] - first.world_from_box[rows, :3, 3]


def _join_twins(group: list[Track]) -> Track:
    """One track of all steps of a group, each step from the first that has it."""
    poses: dict[int, ndarray] = {}
    for track in group:
        for time, pose in zip(track.times, track.world_from_box, strict=True):
            known = round(float(time) / SAME_TIME)
            poses.setdefault(known, pose)
    times = {round(float(time) / SAME_TIME): float(time) for track in reversed(group) for time in track.times}
    ordered = sorted(poses)
    longest = max(group, key=lambda track: len(track.times))
    return replace(
        group[0],
        dimensions=longest.dimensions,
        times=np.array([times[known] for known in ordered]),
        world_from_box=np.stack([poses[known] for known in ordered]),
        moving=any(track.moving for track in group),
    )
