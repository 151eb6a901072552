"""Photos that a scene's file tells of: those of its run, or of the folder that another trainer was given."""

from __future__ import annotations

import re
from pathlib import Path

from instdrive_core.datasets.colmap.clips import holds_colmap
from instdrive_core.datasets.nerfstudio import holds_nerfstudio
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.run_facts import FACTS, read_run_facts
from instdrive_core.finding.clip_of_cameras import find_inria_cameras

_SETTINGS = "cfg_args"
_MOST_BYTES = 1 << 20
_SOURCE = re.compile(r"source_path='([^'\n]{1,1000})'")


def find_known_photos(scene: Path) -> Path | None:
    """Find the folder of photos and poses that a scene's file, or folder, was made of; None where nothing tells.

    A run names its clip, and the INRIA trainer its source, or there are photos beside its ``cameras.json``; else it is
    the folder that the scene lies in, or the one above that, if it is a COLMAP model or has nerfstudio's
    ``transforms.json``. Damaged files count as none.
    """
    folder = scene if scene.is_dir() else scene.parent
    if (folder / FACTS).is_file():
        return _find_clip_of_run(folder)
    above = [folder, *list(folder.parents)[:2]]
    for place in above:
        source = _read_trainer_source(place / _SETTINGS)
        if source is not None and source.is_dir():
            return source
    cameras = find_inria_cameras(scene)
    if cameras is not None and (cameras.parent / "images").is_dir():
        return cameras.parent / "images"
    return next((place for place in above[:2] if holds_nerfstudio(place) or holds_colmap(place)), None)


def _find_clip_of_run(run: Path) -> Path | None:
    try:
        clip = Path(read_run_facts(run)["clip"])
    except InstDriveError:
        return None
    return clip if clip.exists() else None


def _read_trainer_source(settings: Path) -> Path | None:
    try:
        with settings.open("rb") as file:
            found = _SOURCE.search(file.read(_MOST_BYTES).decode())
    except (OSError, UnicodeDecodeError):
        return None
    return None if found is None else Path(found.group(1))
