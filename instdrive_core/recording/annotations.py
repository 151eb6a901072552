"""Boxes that the drive's annotations give standing things, where a trained run says which drive it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.run_facts import FACTS, build_clip_options, read_run_facts
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track


def find_annotated_tracks(run: Path, scene: Scene) -> tuple[tuple[Track, ...], str]:
    """Find the tracks of the clip that a run was trained on, and a sentence for the user where there are none.

    Args:
        run: a run's folder, or any scene, of which nothing is known.
        scene: what was opened of it, not turned since.
    """
    if not (run / FACTS).is_file():
        return (), ""
    fitted = "boxes of standing things are fitted to their splats"
    try:
        facts = read_run_facts(run)
        clip = load_clip(facts["clip"], build_clip_options(facts))
    except InstDriveError as error:
        return (), f"the run's clip cannot be opened, so {fitted} ({error})"
    if not np.allclose(clip.origin, scene.origin):
        return (), f"the clip {clip.path} has another origin than the run, so {fitted}"
    if not clip.tracks:
        return (), f"the clip {clip.path} has no boxes, so {fitted}"
    return clip.tracks, ""
