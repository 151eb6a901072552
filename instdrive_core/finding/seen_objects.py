"""The objects that photos show of a scene, as a file: what a job has found, and whoever edits the scene reads."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load, save

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.project.sources import SceneSource

OBJECTS = "objects.safetensors"
"""Name of the file in the folder of a job."""
_ARRAY, _FACTS = "numbers", "objects"
_REMEDY = "Find the objects again"


@dataclass(frozen=True)
class SeenObjects:
    """Which object each splat of a scene belongs to, by the masks of photos."""

    numbers: UInt32[ndarray, " n"]
    """1, 2, … by falling number of splats, for each row of the scene's file; 0 = none."""
    classes: tuple[str, ...]
    """Class of each object, in order of the numbers; empty = unknown."""
    photos: int
    """Photos whose masks were looked at."""
    scene: str
    """What `identify_rows` calls the scene."""


def identify_rows(source: SceneSource) -> str:
    """Name the rows of a scene: by the digest of its files, and which of their splats were opened."""
    return source.identity.sha256 + (f"/{source.keep_every}" if source.keep_every != 1 else "")


def write_seen_objects(folder: Path, found: SeenObjects) -> None:
    """Write what was found into a folder, whole or not at all."""
    facts = {"classes": found.classes, "photos": found.photos, "scene": found.scene}
    write_bytes(folder / OBJECTS, save({_ARRAY: found.numbers}, {_FACTS: json.dumps(facts)}))


def read_seen_objects(folder: Path) -> SeenObjects:
    """Read what was found into a folder. Raises DataError where nothing was, or the file is damaged."""
    file = folder / OBJECTS
    if not file.is_file():
        raise DataError(file, "no objects have been found there", _REMEDY)
    try:
        numbers = load(require_plain_file(file).read_bytes())[_ARRAY]
        with safe_open(file, "numpy") as opened:
            facts = json.loads((opened.metadata() or {})[_FACTS])
        found = SeenObjects(numbers, tuple(map(str, facts["classes"])), int(facts["photos"]), str(facts["scene"]))
    except (OSError, SafetensorError, KeyError, ValueError, TypeError) as error:
        raise DataError(file, f"it is damaged ({error})", _REMEDY) from error
    if numbers.dtype != np.uint32 or numbers.ndim != 1 or int(numbers.max(initial=0)) > len(found.classes):
        raise DataError(file, "its numbers are no objects of its list", _REMEDY)
    return found
