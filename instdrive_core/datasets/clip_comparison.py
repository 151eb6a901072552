"""How much two clips of one drive differ, whatever layouts they were read from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Clip, Frame, SweepPoints
from instdrive_core.scene.track import Track


@dataclass(frozen=True)
class ClipDifference:
    """Largest differences of what both clips hold."""

    photos: int
    """Photos that were compared."""
    photos_equal: bool
    """Whether all of them have equal pixels."""
    pose_error: float
    """Difference of any number of a pose (metres in its position), relative to the first camera's first pose."""
    lens_error: float
    """Pixels, of fx, fy, cx, cy."""
    sweeps: int
    points: int
    """Points that were compared."""
    point_error_m: float
    """Infinite where a sweep has another number of points."""
    boxes: int
    box_error_m: float
    """Difference of a box's centre or a side, or of its yaw times half its length; infinite where a box is missing."""


def compare_clips(first: Clip, second: Clip, cameras: tuple[tuple[str, str], ...]) -> ClipDifference:
    """Compare clips that were opened at full size; the n-th step of one is the n-th of the other.

    Args:
        first: as it was before.
        second: the same drive, read from another layout; its world may be moved and turned as a whole.
        cameras: names of a camera in the first and in the second.
    """
    frames = [_list_frames(first), _list_frames(second)]
    steps = [sorted({frame.view.index for frame in clip.frames}) for clip in (first, second)]
    pairs = [
        (frames[0][before, one], frames[1][after, other])
        for before, after in zip(*steps, strict=True)
        for one, other in cameras
        if (before, one) in frames[0] and (after, other) in frames[1]
    ]
    alike = all(np.array_equal(one.load_image(), other.load_image()) for one, other in pairs)
    world = _world_poses(first, pairs[0][0]) @ np.linalg.inv(_world_poses(second, pairs[0][1]))
    poses = [np.abs(_world_poses(first, one) - world @ _world_poses(second, other)).max() for one, other in pairs]
    lenses = [_measure_lens(one, other) for one, other in pairs]
    matching = dict(zip(*reversed(steps), strict=True))
    points, point_error = _compare_sweeps(first, second, matching, world)
    boxes, box_error = _compare_tracks(first, second, world)
    return ClipDifference(
        len(pairs), alike, float(max(poses)), max(lenses), len(second.sweeps), points, point_error, boxes, box_error
    )


def _list_frames(clip: Clip) -> dict[tuple[int, str], Frame]:
    return {(frame.view.index, frame.view.name): frame for frame in clip.frames}


def _world_poses(clip: Clip, frame: Frame) -> np.ndarray:
    """The pose in the file's world."""
    pose = frame.view.camera.world_from_camera.copy()
    pose[:3, 3] += clip.origin
    return pose


def _measure_lens(one: Frame, other: Frame) -> float:
    numbers = [
        np.array([frame.view.camera.fx, frame.view.camera.fy, frame.view.camera.cx, frame.view.camera.cy])
        for frame in (one, other)
    ]
    return float(np.abs(numbers[0] - numbers[1]).max())


def _compare_sweeps(first: Clip, second: Clip, matching: dict[int, int], world: np.ndarray) -> tuple[int, float]:
    """Number of points and the largest distance; nearest neighbours where a layout has another order of points."""
    known = {sweep.index: sweep for sweep in first.sweeps}
    count, worst = 0, 0.0
    for sweep in second.sweeps:
        before, after = known[matching[sweep.index]].load(), sweep.load()
        there = (after.points.astype(np.float64) + second.origin) @ world[:3, :3].T + world[:3, 3]
        worst = max(worst, _measure_points(before, first.origin, there))
        count += len(there)
    return count, worst if len(first.sweeps) == len(second.sweeps) else float("inf")


def _measure_points(before: SweepPoints, origin: np.ndarray, after: np.ndarray) -> float:
    here = before.points.astype(np.float64) + origin
    if len(here) != len(after):
        return float("inf")
    in_order = np.linalg.norm(here - after, axis=1).max(initial=0)
    return float(in_order if in_order < 1e-2 else KDTree(after).query(here)[0].max(initial=0))


def _compare_tracks(first: Clip, second: Clip, world: np.ndarray) -> tuple[int, float]:
    others = list(second.tracks)
    count, worst = 0, 0.0
    for track in first.tracks:
        found = _find_track(track, first, others, second, world)
        worst = max(worst, found)
        count += len(track.times)
    return count, worst


def _find_track(track: Track, first: Clip, others: list[Track], second: Clip, world: np.ndarray) -> float:
    """Error of the track's twin: the one of its ID, else the nearest."""
    named = [other for other in others if other.id == track.id]
    errors = [_measure_track(track, first, other, second, world) for other in named or others]
    return min(errors, default=float("inf"))


def _measure_track(track: Track, first: Clip, other: Track, second: Clip, world: np.ndarray) -> float:
    """Largest error over the boxes of both tracks that lie nearest in time."""
    if len(track.times) != len(other.times):
        return float("inf")
    here, there = track.world_from_box.copy(), other.world_from_box.copy()
    here[:, :3, 3] += first.origin
    there[:, :3, 3] += second.origin
    there = world @ there
    centres = np.linalg.norm(here[:, :3, 3] - there[:, :3, 3], axis=1).max()
    sides = np.abs(track.dimensions - other.dimensions).max()
    cosine = (here[:, :2, 1] * there[:, :2, 1]).sum(axis=1)
    sine = here[:, 0, 1] * there[:, 1, 1] - here[:, 1, 1] * there[:, 0, 1]
    yaw = np.abs(np.arctan2(sine, cosine)).max() * track.dimensions[1] / 2
    return float(max(centres, sides, yaw))
