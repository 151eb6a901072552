"""Finding the open scene's objects in photos: begins the job, and gives the document what it found, as one edit."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from instdrive_app.messages import user_message
from instdrive_app.session.context import SessionContext
from instdrive_app.session.files.document_files import DocumentFiles
from instdrive_app.session.making.job_controller import JobController, find_result
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import EditError
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.user_folders import find_state_folder
from instdrive_core.finding.known_photos import find_known_photos
from instdrive_core.finding.relabeling import plan_relabeling
from instdrive_core.finding.seen_objects import SeenObjects, identify_rows, read_seen_objects
from instdrive_core.jobs.job_file import EDITS, locate_job_file, read_job_state
from instdrive_core.project.save import write_project
from instdrive_core.project.sources import SceneSource, SceneSources
from instdrive_core.wording import format_count, phrase

_FOLDER = "objects"
"""Folder of the jobs, below that of the program's state: nobody has to name one."""


@dataclass(frozen=True)
class FindChoice:
    """What the user chose."""

    photos: Path
    masks: str
    """Folder of masks, or source that makes them; empty = the best there are."""
    replaces: bool
    """Whether instances are replaced."""

    def list_arguments(self) -> list[str]:
        """List the arguments of ``instdrive find-objects``."""
        arguments = ["--photos", str(self.photos)]
        arguments += ["--masks", self.masks] if self.masks else []
        return [*arguments, "--replace"] if self.replaces else arguments


class ObjectFinder:
    """Begins jobs that find the objects of the open scene, and makes them instances of it."""

    def __init__(self, context: SessionContext, files: DocumentFiles, making: JobController) -> None:
        self._context, self._files, self._making = context, files, making
        making.openers["find-objects"] = self.take

    @property
    def obstacle(self) -> str:
        """Why no job can begin now; empty where one can."""
        if self._base is None:
            return "The open scene comes from no file; export it, and open the export"
        if find_spec("torch") is None:
            return str(explain_missing_module(ModuleNotFoundError(name="torch")))
        if self._making.is_running:
            return "Another training is running. Wait for it, or stop it first."
        return ""

    @property
    def known_photos(self) -> Path | None:
        """The folder of photos that the open scene was made of; None where nothing tells."""
        return None if self._base is None else find_known_photos(self._base.path)

    def build_look_command(self, photos: Path) -> tuple[str, ...] | None:
        """Build the command that tells of photos in which objects of the open scene are looked for."""
        base = self._base
        return None if base is None else ("find-objects", str(base.path), "--photos", str(photos), "--look")

    def count_free_splats(self) -> int:
        """Count the open document's splats that belong to no instance."""
        document = self._context.document
        return 0 if document is None else int(np.count_nonzero(document.scene.instance_ids == 0))

    def begin(self, choice: FindChoice) -> None:
        """Begin a job on the open document, whose edits are kept as they are now, saved or not."""
        base = self._base
        if base is None:
            return
        state, source = self._files.capture(), self._files.path or base.path
        run = _make_folder(source.stem)
        kept = locate_job_file(run, EDITS)

        def start(_: None) -> None:
            self._making.begin_finding(source, run, choice.list_arguments())

        self._context.jobs.submit("Keeping the edits", lambda: write_project(kept, state), start, modal=False)

    def take(self, run: Path) -> None:
        """Give the open document what a job has found; where another scene is open, open the job's project."""

        def finish(found: SeenObjects) -> None:
            document, base = self._context.document, self._base
            if document is None or base is None or identify_rows(base) != found.scene:
                self._files.leave_for(find_result(run))
                return
            self._relabel(run, document, found)

        self._context.jobs.submit("Looking for objects", lambda: read_seen_objects(run), finish, modal=False)

    def _relabel(self, run: Path, document: Document, found: SeenObjects) -> None:
        replaces = read_job_state(run).request.replaces
        try:
            edit = plan_relabeling(document, found, replaces)
        except EditError as error:
            self._context.messages.error(user_message(error))
            return
        had_none = not len(document.scene.table)
        if not self._context.apply(edit):
            return
        if had_none:  # a region would have selected no instance before
            self._context.state.region_splats = False
        self._making.known.remove(run)
        self._context.messages.info(
            phrase(
                "{found} found in the masks of {photos}; click them like any instance",
                found=format_count(len(edit.parts), "object"),
                photos=format_count(found.photos, "photo"),
            )
        )

    @property
    def _base(self) -> SceneSource | None:
        document = self._context.document
        sources = None if document is None else document.open_scene
        return sources.base if isinstance(sources, SceneSources) else None


def _make_folder(name: str) -> Path:
    """Make a new folder for a job, named after its scene."""
    plain = re.sub(r"[^\w. -]", "", name).strip(". ") or "scene"
    parent = find_state_folder() / _FOLDER
    number = 1
    while True:
        folder = parent / (f"{plain} objects" if number == 1 else f"{plain} objects {number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
            continue
        return folder
