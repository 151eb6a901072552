"""The finished run that training goes on from: its scene, and the clip that it was trained on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, OptionError
from instdrive_core.evaluation.run_facts import FACTS, build_clip_options, read_run_facts
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.masks.label_map_folder import SIDECAR, MaskFolder, open_masks
from instdrive_core.scene.scene import Scene

MASK_FOLDER = "mask_folder"
"""Field of `run.json` that names the masks of a run that was itself trained on from another."""
_SAME_SIZE = 1.0
"""Pixels by which focal lengths of the clip and of the scene's cameras may differ."""


@dataclass(frozen=True)
class BaseRun:
    """A finished run, opened."""

    run: Path
    facts: dict[str, Any]
    """The fields of `run.json`."""
    scene: Scene
    """The scene without edits."""
    clip: Clip


def locate_base_run(scene: Path) -> Path:
    """Locate the run that a scene belongs to: its folder, or that of its manifest.

    Raises OptionError where it is no run: nothing tells which photos show it then.
    """
    run = scene if scene.is_dir() else scene.parent
    if not (run / FACTS).is_file() or (scene.is_file() and scene.suffix != ".json"):
        raise OptionError(
            f"{scene} is no run that `make` or `train` wrote, so its photos are not known. Learn it as a run first: "
            "instdrive train CLIP -o RUN --init SCENE --freeze-geometry"
        )
    return run


def open_base_run(run: Path, clip: Path | None = None) -> BaseRun:
    """Open a run's scene and clip; `clip` is where the clip is now, where it has moved.

    Raises DataError where run or clip cannot be read, or the clip is another one, OptionError for a scene that this
    program cannot train on.
    """
    facts = read_run_facts(run)
    path = Path(facts["clip"]) if clip is None else clip
    if not path.exists():
        raise DataError(path, f"the clip of {run} is not there any more", "Put it back, or say where it is: --clip")
    scene = read_scene_folder(run)
    if scene.antialiased:
        raise OptionError(f"{run}: its splats fade with the pixel filter (antialiased), which training does not do.")
    if not len(scene):
        raise OptionError(f"{run}: the scene is empty.")
    opened = load_clip(str(path.resolve()), build_clip_options(facts))
    _check_same_clip(run, scene, opened)
    return BaseRun(run, facts, scene, opened)


def open_base_masks(base: BaseRun) -> MaskFolder | None:
    """Open the masks that the run was trained with, which tell sky from things; None where they are gone."""
    named = base.facts.get(MASK_FOLDER)
    folders = [Path(named)] if isinstance(named, str) else []
    keys = {frame.key for frame in base.clip.training_frames}
    for folder in (*folders, base.run / "masks", Path(base.clip.path) / "masks"):
        if (folder / SIDECAR).is_file():
            masks = open_masks(folder)
            if keys <= masks.counts.keys():
                return masks
    return None


def _check_same_clip(run: Path, scene: Scene, clip: Clip) -> None:
    remedy = f"Give the clip that {run} was trained on, or train a new run of this one with `make`"
    frames = clip.training_frames
    if not frames:
        raise DataError(clip.path, "no photo of a training time step was found", remedy)
    if not np.allclose(clip.origin, scene.origin):
        raise DataError(clip.path, f"is another clip: its origin {clip.origin} is not {scene.origin}", remedy)
    known = {f"{view.name}/{view.index:02d}": view.camera for view in scene.views}
    for frame in frames:
        camera = known.get(frame.key)
        if camera is None:
            raise DataError(clip.path, f"is another clip: the scene knows no photo {frame.key}", remedy)
        mine = frame.view.camera
        if (mine.width, mine.height) != (camera.width, camera.height) or abs(mine.fx - camera.fx) > _SAME_SIZE:
            size = f"{mine.width}×{mine.height}, not {camera.width}×{camera.height}"
            raise DataError(clip.path, f"is another clip: photo {frame.key} is {size} or of another lens", remedy)
