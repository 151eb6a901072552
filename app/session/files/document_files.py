"""The open document's files: opening, recovering and saving them in the background."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from instdrive_app.files.file_names import find_name_problem
from instdrive_app.messages import read_error
from instdrive_app.session.context import SessionContext
from instdrive_app.session.files.autosave import Autosave
from instdrive_app.session.files.opening import OpenedDocument, open_for_editing, recover_for_editing
from instdrive_app.session.files.recents import RecentFiles
from instdrive_app.session.files.sketches import OpeningScene
from instdrive_app.session.requests import (
    AskChangedScene,
    AskOtherSave,
    AskTooLarge,
    AskUnsaved,
    OfferRecovery,
    do_nothing,
)
from instdrive_app.session.view_memory import store_view
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.errors import SceneChangedError, SceneTooLargeError
from instdrive_core.files.user_folders import find_state_folder
from instdrive_core.project.recoverable import RecoverableSession, find_pending_sessions
from instdrive_core.project.save import ProjectState, capture_project_state, is_project, write_project
from instdrive_core.scene.lint import Defect
from instdrive_core.wording import phrase

Stamp = tuple[int, int]
"""When a file was written, nanoseconds, and its size in bytes."""


class DocumentFiles:
    """Knows which files the open document came from and went to, and what is not saved yet."""

    def __init__(
        self,
        context: SessionContext,
        show: Callable[[OpenedDocument], None],
        store_more: Callable[[], dict[str, Any]] = dict,
        get_more_version: Callable[[], int] = int,
        show_sketch: Callable[[OpeningScene, Document], None] = lambda opening, sketch: None,
    ) -> None:
        """`show` gets each document that was opened; `store_more` gives what a project keeps beside the view.

        `get_more_version` gives a number that rises whenever the user has changed that. `show_sketch` gets sketches of
        large scenes on the thread that opens them.
        """
        self._show_sketch = show_sketch
        self._get_more_version, self._saved_more = get_more_version, 0
        self._store_more = store_more
        self._context, self._jobs, self._messages, self._show = context, context.jobs, context.messages, show
        self.path: Path | None = None
        """Where the open document came from: a scene or a project."""
        self.last_export: Path | None = None
        """Set by `ExportController`."""
        self.defects: tuple[Defect, ...] = ()
        """What is wrong with the splats of the scene opened last."""
        self.recents = RecentFiles(find_state_folder() / "recent.json")
        self.autosave = Autosave(context.messages.error)
        self._saved: tuple[Edit, ...] | None = ()
        self._stamp: Stamp | None = None
        """Stamp of the project as it was opened or saved here."""

    @property
    def project(self) -> Path | None:
        """The project file that Save writes; None where there is none yet."""
        return self.path if self.path is not None and is_project(self.path) else None

    @property
    def is_unsaved(self) -> bool:
        """Whether the document differs from its project, or from the scene while there is no project."""
        document = self._context.document
        is_changed = self._get_more_version() != self._saved_more
        return document is not None and (is_changed or list_changes(document) != self._saved)

    def enter(self, document: Document, path: Path | None, saved: bool = True) -> None:
        """Follow a document from `path`; a recovered one is not `saved`, its file lacks something."""
        self.path, self._saved = path, list_changes(document) if saved else None
        self._stamp = _read_stamp(path) if path is not None else None
        self._saved_more = self._get_more_version()
        if path is not None:
            self.recents.add(path)

    def leave(self, then: Callable[[], None]) -> None:
        """Do what closes the document, `then`; where there are unsaved changes, the user is asked first."""
        if self.is_unsaved:
            self._context.requests.put(AskUnsaved(then))
        else:
            then()

    def leave_for(self, path: Path) -> None:
        """Leave the open document for the one at `path`."""
        self.leave(lambda: self.open(path))

    def open(self, path: Path, accept_changed: bool = False, keep_every: int = 1) -> None:
        """Open a scene or a project, or every k-th splat of a scene, in the background.

        Asks the user where the scene of a project has changed, and where only part of a scene fits into memory.
        """
        if find_name_problem(path):
            self._messages.error(find_name_problem(path))
            return

        def handle_failure(error: BaseException) -> bool:
            if isinstance(error, SceneTooLargeError) and error.keep_every is not None:
                self._context.requests.put(AskTooLarge(path, error))
                return True
            return self._ask_about_change(error, lambda: self.open(path, accept_changed=True))

        opening = OpeningScene(path)

        def work() -> OpenedDocument:
            return open_for_editing(path, accept_changed, keep_every, partial(self._show_sketch, opening))

        title = phrase("Opening {name}", name=path.name)
        opening.job = self._jobs.submit(title, work, self._show, on_failure=handle_failure)

    def offer_recovery(self) -> None:
        """Look for the work of editors that ended without saving, and offer it; the answer may come frames later."""

        def offer(found: list[RecoverableSession]) -> None:
            self.autosave.recoverable = found
            if found:
                self._context.requests.put(OfferRecovery())

        self._jobs.submit("Looking for unsaved work", find_pending_sessions, offer, modal=False)

    def recover(self, session: RecoverableSession) -> None:
        """Leave the open document for the work of an editor that ended without saving."""
        self.leave(lambda: self._recover(session))

    def _recover(self, session: RecoverableSession, accept_changed: bool = False) -> None:
        def show(found: OpenedDocument) -> None:
            self.autosave.forget(session)
            self._show(found)

        def handle_failure(error: BaseException) -> bool:
            return self._ask_about_change(error, lambda: self._recover(session, accept_changed=True))

        def work() -> OpenedDocument:
            return recover_for_editing(session, accept_changed)

        self._jobs.submit(phrase("Recovering {title}", title=session.title), work, show, on_failure=handle_failure)

    def capture(self) -> ProjectState:
        """Take the open document's edits, saved or not, and the view. Raises DataError where it comes from no file."""
        document = self._context.document
        if document is None:
            raise ValueError("no document is open")
        return capture_project_state(document, store_view(self._context.state) | self._store_more())

    def save(self, path: Path | None = None, then: Callable[[], None] = do_nothing) -> None:
        """Write the project in the background, to its own file where no path is given; `then` follows a success.

        The document can be edited meanwhile. Asks the user where another editor has saved the same project since.
        """
        document, path = self._context.document, path or self.project
        if document is not None and path is not None:
            self._save(document, path, store_view(self._context.state) | self._store_more(), then)

    def _save(
        self, document: Document, path: Path, view: dict[str, Any], then: Callable[[], None], over_other: bool = False
    ) -> None:
        state, changes = capture_project_state(document, view), list_changes(document)
        more = self._get_more_version()

        def work() -> None:
            # Looked at here, where the save before this one is done.
            is_own = over_other or path != self.path or self._stamp is None
            if not is_own and _read_stamp(path) not in (None, self._stamp):
                raise _SavedElsewhereError
            write_project(path, state)
            self._stamp = _read_stamp(path)

        def finish(_: None) -> None:
            self.path, self._saved, self._saved_more = path, changes, more
            self.autosave.note_save(path, state)
            self.recents.add(path)
            self._messages.info(phrase("Saved {path}", path=path))
            then()

        def handle_failure(error: BaseException) -> bool:
            if isinstance(error, _SavedElsewhereError):
                save_over = partial(self._save, document, path, view, then, over_other=True)
                self._context.requests.put(AskOtherSave(path, save_over))
            return isinstance(error, _SavedElsewhereError)

        self._jobs.submit(phrase("Saving {name}", name=path.name), work, finish, modal=False, on_failure=handle_failure)

    def _ask_about_change(self, error: BaseException, open_anyway: Callable[[], None]) -> bool:
        if isinstance(error, SceneChangedError):
            self._context.requests.put(AskChangedScene(read_error(error), open_anyway))
        return isinstance(error, SceneChangedError)


class _SavedElsewhereError(Exception):
    """The project's file is not the one that was opened or saved here."""


def _read_stamp(path: Path) -> Stamp | None:
    """What a file looks like from outside; None where it cannot be looked at."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def list_changes(document: Document) -> tuple[Edit, ...]:
    """The edits done that changed more than the selection."""
    return tuple(edit for edit in document.history.done if not edit.selects_only)
