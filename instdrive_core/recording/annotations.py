"""Boxes that the drive's annotations give standing things, where a trained run says which drive it was."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.recording.run_clip import open_run_clip
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track


def find_annotated_tracks(run: Path, scene: Scene) -> tuple[tuple[Track, ...], str]:
    """Find the tracks of the clip that a run was trained on, and a sentence for the user where there are none.

    Args:
        run: a run's folder, or any scene, of which nothing is known.
        scene: what was opened of it, not turned since.
    """
    clip, problem = open_run_clip(run, scene)
    if clip is not None and not clip.tracks:
        problem = f"the clip {clip.path} has no boxes"
    if problem:
        return (), f"{problem}, so boxes of standing things are fitted to their splats"
    return (clip.tracks if clip is not None else ()), ""
