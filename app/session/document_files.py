"""The open document's files: opening and saving, beside the window."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from instdrive_app.files.file_names import find_name_problem
from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages
from instdrive_app.session.autosave import Autosave
from instdrive_app.session.opening import OpenedDocument, open_for_editing, recover_for_editing
from instdrive_app.session.recents import RecentFiles
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.errors import SceneChangedError, SceneTooLargeError
from instdrive_core.files.user_folders import find_state_folder
from instdrive_core.project.recoverable import RecoverableSession, find_pending_sessions
from instdrive_core.project.save import capture_project_state, is_project, write_project

Stamp = tuple[int, int]
"""When a file was written, nanoseconds, and its size in bytes."""


@dataclass(frozen=True)
class ChangedScene:
    """A document that can be opened anyway, though the scene is another one by now."""

    said: str
    """What the user is told about it."""
    open_anyway: Callable[[], None]
    """Opens it without the edits that do not fit any more."""


@dataclass(frozen=True)
class OtherSave:
    """A project that another editor has saved since it was opened or saved here."""

    path: Path
    save_over: Callable[[], None]


class DocumentFiles:
    """What is on the disk of the open document, and what is not yet."""

    def __init__(
        self, jobs: Jobs, messages: Messages, autosave: Autosave, show: Callable[[OpenedDocument], None]
    ) -> None:
        """`show` gets each document that was opened; `autosave` follows the one that is shown."""
        self._jobs, self._messages, self._autosave, self._show = jobs, messages, autosave, show
        self.path: Path | None = None
        """Where the open document came from: a scene or a project."""
        self.last_export: Path | None = None
        """Written by `exporting.Exporting`."""
        self.changed_scene: ChangedScene | None = None
        """A document whose scene is no longer the one that was edited: to be asked about."""
        self.too_large: tuple[Path, SceneTooLargeError] | None = None
        """A scene that does not fit into memory, of which a part does: to be asked about."""
        self.other_save: OtherSave | None = None
        """A project that another editor has saved since: to be asked about before it is written over."""
        self.recents = RecentFiles(find_state_folder() / "recent.json")
        self._saved: tuple[Edit, ...] | None = ()
        self._stamp: Stamp | None = None
        """Of the project as it was opened or saved here."""

    @property
    def project(self) -> Path | None:
        """The project file that Save writes; None where there is none yet."""
        return self.path if self.path is not None and is_project(self.path) else None

    def entered(self, document: Document, path: Path | None, saved: bool = True) -> None:
        """A document is shown that came from `path`; where it was recovered, its file lacks something."""
        self.path, self._saved = path, list_changes(document) if saved else None
        self._stamp = _read_stamp(path) if path is not None else None
        if path is not None:
            self.recents.add(path)

    def is_unsaved(self, document: Document) -> bool:
        """Whether the document differs from its project, or from the scene while there is no project."""
        return list_changes(document) != self._saved

    def open(self, path: Path, accept_changed: bool = False, keep_every: int = 1) -> None:
        """Open a scene or a project, or every k-th splat of a scene.

        Where its scene has changed, `changed_scene` is set instead; where only a part of it fits, `too_large`.
        """
        if find_name_problem(path):
            self._messages.error(find_name_problem(path))
            return

        def failed(error: BaseException) -> bool:
            if isinstance(error, SceneTooLargeError) and error.keep_every is not None:
                self.too_large = (path, error)
                return True
            return self._asks_about_change(error, lambda: self.open(path, accept_changed=True))

        def work() -> OpenedDocument:
            return open_for_editing(path, accept_changed, keep_every)

        self._jobs.submit(f"Opening {path.name}", work, self._show, failed=failed)

    def find_recoverable(self, ask: Callable[[], None]) -> None:
        """Look for what dead editors have left; `ask` is called where there is something."""

        def done(found: list[RecoverableSession]) -> None:
            self._autosave.recoverable = found
            if found:
                ask()

        self._jobs.submit("Looking for unsaved work", find_pending_sessions, done, modal=False)

    def _asks_about_change(self, error: BaseException, open_anyway: Callable[[], None]) -> bool:
        if isinstance(error, SceneChangedError):
            self.changed_scene = ChangedScene(str(error), open_anyway)
        return isinstance(error, SceneChangedError)

    def recover(self, session: RecoverableSession, accept_changed: bool = False) -> None:
        """Open the document that a dead editor has left, or set `changed_scene` where its scene has changed."""

        def done(found: OpenedDocument) -> None:
            self._autosave.forget(session)
            self._show(found)

        def failed(error: BaseException) -> bool:
            return self._asks_about_change(error, lambda: self.recover(session, accept_changed=True))

        self._jobs.submit(
            f"Recovering {session.title}", lambda: recover_for_editing(session, accept_changed), done, failed=failed
        )

    def save(
        self,
        document: Document,
        path: Path,
        view: dict[str, Any],
        then: Callable[[], None] = lambda: None,
        over_other: bool = False,
    ) -> None:
        """Write the document's project; it can be edited meanwhile. `then` is called when the file is whole.

        Where another editor has saved the same project since, `other_save` is set instead, unless `over_other`.
        """
        state, changes = capture_project_state(document, view), list_changes(document)

        def work() -> None:
            # Looked at here, where the save before this one is done.
            is_own = over_other or path != self.path or self._stamp is None
            if not is_own and _read_stamp(path) not in (None, self._stamp):
                raise _SavedElsewhereError
            write_project(path, state)
            self._stamp = _read_stamp(path)

        def done(_: None) -> None:
            self.path, self._saved = path, changes
            self._autosave.saved(path, state)
            self.recents.add(path)
            self._messages.info(f"Saved {path}")
            then()

        def failed(error: BaseException) -> bool:
            if isinstance(error, _SavedElsewhereError):
                self.other_save = OtherSave(path, lambda: self.save(document, path, view, then, over_other=True))
            return isinstance(error, _SavedElsewhereError)

        self._jobs.submit(f"Saving {path.name}", work, done, modal=False, failed=failed)


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
