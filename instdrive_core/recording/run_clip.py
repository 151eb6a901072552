"""The clip that a run was trained on, where the run says which it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.run_facts import FACTS, build_clip_options, read_run_facts
from instdrive_core.scene.scene import Scene


def open_run_clip(run: Path, scene: Scene) -> tuple[Clip | None, str]:
    """Open the clip of a run; None, and why, where that cannot be done. Nothing is said of scenes that are no runs.

    Args:
        run: a run's folder, or any scene, of which nothing is known.
        scene: what was opened of it, not turned since.
    """
    if not (run / FACTS).is_file():
        return None, ""
    try:
        facts = read_run_facts(run)
        clip = load_clip(facts["clip"], build_clip_options(facts))
    except InstDriveError as error:
        return None, f"the run's clip cannot be opened ({error})"
    if not np.allclose(clip.origin, scene.origin):
        return None, f"the clip {clip.path} has another origin than the run"
    return clip, ""
