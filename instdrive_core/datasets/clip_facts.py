"""What a driving clip holds, as labels and texts."""

from __future__ import annotations

from collections import Counter

import numpy as np

from instdrive_core.datasets.clip import Clip


def list_clip_facts(layout: str, clip: Clip) -> list[tuple[str, str]]:
    """List labels and texts: photos, LiDAR, boxes, and what is missing.

    Args:
        layout: title of the clip's data set.
        clip: opened at full size.
    """
    steps = sorted({frame.view.index for frame in clip.frames})
    times = [frame.view.time for frame in clip.frames]
    facts = [
        ("layout", layout),
        ("steps", f"{len(steps)}, {steps[0]} to {steps[-1]}, {min(times):g} to {max(times):g} s"),
        ("photos", f"{len(clip.frames):,} of {len(clip.camera_names)} cameras"),
    ]
    for name in clip.camera_names:
        frames = [frame for frame in clip.frames if frame.view.name == name]
        camera = frames[0].view.camera
        size = f"{len(frames)} photos of {camera.width}×{camera.height}, fx {camera.fx:.1f}, fy {camera.fy:.1f}"
        hidden = "" if frames[0].valid is None else f", {1 - frames[0].valid.mean():.0%} of a photo is masked"
        facts.append((f"  {name}", size + hidden))
    facts.append(("LiDAR", _describe_sweeps(clip)))
    facts.append(("boxes", _describe_tracks(clip)))
    facts.append(
        ("classes", f"{len(clip.class_names)} for LiDAR points" if clip.class_names else "none for LiDAR points")
    )
    facts += [("note", note) for note in clip.notes]
    return facts


def _describe_sweeps(clip: Clip) -> str:
    if not clip.sweeps:
        return "none"
    first = clip.sweeps[0].load()
    sensors = len(np.unique(first.sensor))
    times = "each with its time" if first.times is not None else "without times"
    return f"{len(clip.sweeps)} sweeps; the first has {len(first.points):,} points of {sensors} LiDARs, {times}"


def _describe_tracks(clip: Clip) -> str:
    if not clip.tracks:
        return "none"
    labels = Counter(track.label for track in clip.tracks)
    named = ", ".join(f"{count} {label}" for label, count in labels.most_common(6))
    more = f", {len(labels) - 6} more classes" if len(labels) > 6 else ""
    boxes = sum(len(track.times) for track in clip.tracks)
    moving = sum(track.moving for track in clip.tracks)
    return f"{boxes:,} of {len(clip.tracks)} tracks, {moving} of them moving ({named}{more})"
