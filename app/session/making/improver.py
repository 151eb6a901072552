"""Training on from the open scene: its edits as they are now go along, and so do those made while it trains."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from instdrive_app.session.context import SessionContext
from instdrive_app.session.files.document_files import DocumentFiles, list_changes
from instdrive_app.session.making.job_controller import JobController
from instdrive_core.edits.document.edit import Edit
from instdrive_core.evaluation.run_facts import FACTS
from instdrive_core.extras import explain_missing_module
from instdrive_core.jobs.job_file import EDITS, locate_job_file, locate_project
from instdrive_core.project.carrying.carried_project import CarriedEdits, carry_project
from instdrive_core.project.save import write_project
from instdrive_core.project.sources import SceneSources
from instdrive_core.wording import phrase


class Improver:
    """Begins jobs that train on from the open scene, and opens what they made with all its edits."""

    def __init__(self, context: SessionContext, files: DocumentFiles, making: JobController) -> None:
        self._context, self._files, self._making = context, files, making
        self._begun: tuple[Path, Path, tuple[Edit, ...]] | None = None
        """The run of the job begun here, the scene that it goes on from, and the changes it began with."""
        making.openers["improve"] = self.open

    @property
    def base(self) -> Path | None:
        """The run that the open document's scene belongs to; None where it is no run, or only a part of one is open."""
        document = self._context.document
        sources = None if document is None else document.open_scene
        if not isinstance(sources, SceneSources) or sources.base.keep_every != 1:
            return None
        path = sources.base.path
        if path.name == "scene.json":
            path = path.parent
        return path if (path / FACTS).is_file() else None

    @property
    def obstacle(self) -> str:
        """Why the open scene cannot train on now; empty where it can."""
        if self.base is None:
            return "The open scene is no run, so its photos are not known"
        if find_spec("torch") is None:
            return str(explain_missing_module(ModuleNotFoundError(name="torch")))
        if self._making.is_running:
            return "Another training is running. Wait for it, or stop it first."
        return ""

    def begin(self, run: Path, minutes: float) -> None:
        """Begin a job in a new folder, with the open document's edits as they are now, saved or not."""
        document, base = self._context.document, self.base
        if document is None or base is None:
            return
        state, changes = self._files.capture(), list_changes(document)

        def start(_: None) -> None:
            self._begun = run, base, changes
            self._making.begin_improving(self._files.path or base, run, minutes)

        kept = locate_job_file(run, EDITS)
        self._context.jobs.submit("Keeping the edits", lambda: write_project(kept, state), start, modal=False)

    def open(self, run: Path) -> None:
        """Open an improved scene. The edits of the open document, where the job began with them, have gone along; those
        made since are brought over, so that nothing has to be saved or discarded."""
        document, project = self._context.document, locate_project(run)
        is_ours = self._begun is not None and self._begun[:2] == (run, self.base)
        if document is None or not is_ours or self._begun is None:
            self._files.leave_for(project if project.is_file() else run)
        elif list_changes(document) == self._begun[2]:
            self._files.open(project)
        else:
            self._bring_over(run, project)

    def _bring_over(self, run: Path, project: Path) -> None:
        state, kept = self._files.capture(), locate_job_file(run, EDITS)

        def work() -> CarriedEdits:
            write_project(kept, state)
            return carry_project(kept, run, project)

        def show(carried: CarriedEdits) -> None:
            for note in carried.notes:
                self._context.messages.info(note)
            self._files.open(project)

        self._context.jobs.submit(phrase("Bringing the edits to {name}", name=run.name), work, show)
