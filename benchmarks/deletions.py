"""One thing deleted as the editor does it, and how it looks before and after its residue and its hole are gone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.uncovered import Errors, Uncovered, draw_photo, measure_errors
from instdrive_core.edits.deletions.deletion_report import DeletionReport, report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import EditError
from instdrive_core.scene.scene import Scene


@dataclass(frozen=True)
class Deletion:
    """A deletion, its report, and the scene before and after what the report offers."""

    report: DeletionReport
    gone: Scene
    filled: Scene
    seconds: float
    """Report, clean-up and fill."""
    refused: tuple[str, ...]
    """Why edits that the report offers could not be done."""


@dataclass
class Result:
    """Errors of all things so far."""

    before: list[dict[str, Errors]] = field(default_factory=list)
    after: list[dict[str, Errors]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)

    def add(self, name: str, deletion: Deletion, photos: Sequence[Uncovered]) -> None:
        """Compare one deletion with photos without the thing."""
        self.refused += [f"{name}: {why}" for why in deletion.refused]
        self.seconds.append(deletion.seconds)
        self.before.append(measure_errors(deletion.gone, photos))
        self.after.append(measure_errors(deletion.filled, photos))


def delete_and_fill(scene: Scene, number: int, moment: float) -> Deletion:
    """Delete instance `number` in a copy of the scene, as shown at `moment` (seconds), clean up and fill."""
    document, refused = Document(deepcopy(scene)), []
    document.apply(DeleteInstances((number,)))
    gone = bake_document(document)
    started = time.perf_counter()
    report = report_deletion(document, (number,), moment)
    for edit in (report.make_absorb_edit(), *report.make_fill_edits()):
        try:
            if edit is not None:
                document.apply(edit)
        except EditError as error:
            refused.append(str(error))
    seconds = time.perf_counter() - started
    return Deletion(report, gone, bake_document(document), seconds, tuple(refused))


def save_comparison(file: Path, deletion: Deletion, photos: Sequence[Uncovered]) -> None:
    """Write a picture with a row for each photo: truth, deleted, filled."""
    file.parent.mkdir(parents=True, exist_ok=True)
    scenes = (deletion.gone, deletion.filled)
    rows = [np.hstack([photo.truth, *(draw_photo(each, photo.view) for each in scenes)]) for photo in photos]
    Image.fromarray((np.vstack(rows) * 255).round().astype(np.uint8)).save(file)
