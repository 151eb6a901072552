"""Everything about a drive that a user should know before it trains: gaps, missing times, poses of other steps."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from instdrive_core.datasets.checks.pose_shift import PoseShift, find_pose_shifts
from instdrive_core.datasets.clip import Clip

LATEST = 1.0
"""Seconds that a point's time may lie off its sweep's; beyond, the times are those of another clock."""
_LONG_PAUSE = 2.5
"""Times the usual step, above which the clock has jumped."""
_NAMED = 4
"""Gaps that a note names one by one."""


def describe_faults(clip: Clip) -> list[str]:
    """Describe what is wrong with a drive that can train all the same: file, what, and what to do. Reads a few photos
    and sweeps.

    Raises DataError where one of them is damaged.
    """
    notes = [*_describe_gaps(clip), *_describe_pauses(clip)]
    if clip.sweeps:
        notes += _describe_times(clip)
        notes += [_describe_shift(clip, shift) for shift in find_pose_shifts(clip)]
    return notes


def _describe_gaps(clip: Clip) -> list[str]:
    root, notes = Path(clip.path), []
    steps: dict[str, list[tuple[int, Path]]] = {name: [] for name in clip.camera_names}
    for frame in clip.frames:
        steps[frame.view.name].append((frame.view.index, Path(frame.view.photo)))
    for name, photos in steps.items():
        missing = _find_gaps([index for index, _ in photos])
        if missing:
            folder = photos[0][1].parent
            notes.append(
                f"{folder}: {name} has no photo of {missing}; movers are interpolated there. "
                "Copy the missing photos, or train the parts apart with --first and --last"
            )
    missing = _find_gaps([sweep.index for sweep in clip.sweeps])
    if missing:
        notes.append(
            f"{root / 'lidar'}: there is no sweep of {missing}; depth there comes from its neighbours. "
            "Copy the missing sweeps if you have them"
        )
    return notes


def _find_gaps(indices: list[int]) -> str:
    """Steps missing between the first and the last, as words; empty where none is, or every second one is missing."""
    pairs = list(pairwise(sorted(set(indices))))
    stride = int(np.median([after - before for before, after in pairs])) if pairs else 1
    gaps = [(before + 1, after - 1) for before, after in pairs if after > before + stride]
    if not gaps:
        return ""
    named = ", ".join(f"{first}" if first == last else f"{first}–{last}" for first, last in gaps[:_NAMED])
    more = f" and {len(gaps) - _NAMED} more gaps" if len(gaps) > _NAMED else ""
    single = len(gaps) == 1 and gaps[0][0] == gaps[0][1]
    return f"{'step' if single else 'steps'} {named}{more}"


def _describe_pauses(clip: Clip) -> list[str]:
    """Where the clock jumps between neighbouring steps."""
    times = {frame.view.index: frame.view.time for frame in clip.frames}
    pairs = [(before, after) for before, after in pairwise(sorted(times)) if after == before + 1]
    waits = np.array([times[after] - times[before] for before, after in pairs])
    if len(waits) < 2:
        return []
    usual = float(np.median(waits))
    long = [(pair, wait) for pair, wait in zip(pairs, waits, strict=True) if wait > _LONG_PAUSE * usual]
    if not long:
        return []
    (before, after), wait = max(long, key=lambda found: found[1])
    return [
        f"{Path(clip.path)}: timestamps jump by {wait:.2f} s from step {before} to {after}, usually by {usual:.2f} s "
        f"({len(long)} such jumps). If frames are missing there, train the parts apart with --first and "
        "--last"
    ]


def _describe_times(clip: Clip) -> list[str]:
    """Sweeps, of three looked at, whose points have no usable time."""
    places = np.unique(np.linspace(0, len(clip.sweeps) - 1, min(3, len(clip.sweeps))).round().astype(int))
    for sweep in (clip.sweeps[place] for place in places):
        times, file = sweep.load().times, Path(clip.path) / "lidar" / f"{sweep.index:02d}"
        remedy = (
            "moving objects are placed as if each sweep were taken in one moment. Write each point's time in seconds"
        )
        if times is None:
            return [f"{file}: the column 't' is missing; {remedy} into it"]
        if len(times) and np.abs(times - sweep.time).max() > LATEST:
            off = float(np.median(times - sweep.time))
            return [f"{file}: the column 't' is {off:.4g} s off the sweep's timestamp; {remedy} of the same clock"]
    return []


def _describe_shift(clip: Clip, shift: PoseShift) -> str:
    root = Path(clip.path)
    file = root / "camera" / (shift.camera or "*") / "poses.json"
    other = "before" if shift.steps < 0 else "after"
    return (
        f"{file}: photos fit the poses of the step {other} better than their own "
        f"({shift.agreement:.0%} of {shift.photos} photos): the list of poses seems off by one. "
        f"Shift it by one entry against the photos, or get the file again"
    )
