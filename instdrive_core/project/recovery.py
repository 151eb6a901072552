"""Autosave: every edit goes into a journal in the user's state folder, from which the next editor recovers it."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

from instdrive_core.edits.document.document import Document
from instdrive_core.errors import DataError
from instdrive_core.files.file_lock import FileLock
from instdrive_core.project.edit_log import LoggedHistory, count_shared_edits, diff_histories
from instdrive_core.project.journal import EditJournal
from instdrive_core.project.manifest import source_to_json
from instdrive_core.project.recoverable import RestoredSession, find_session_root
from instdrive_core.project.save import ProjectState
from instdrive_core.project.session_folder import (
    JOURNAL,
    make_session_folder,
    remove_session,
    write_session,
)
from instdrive_core.project.sources import get_sources, record_source

WRITE_INTERVAL = 0.1
"""Seconds at least between two lines: of a slider's drag only what stands at the end of each is written."""
SYNC_INTERVAL = 1.0
"""Seconds at least between two calls that wait for the disk, and at most until an edit survives a power cut."""


class Recovery:
    """The journal of one open document, written by a thread of its own; made by `begin`.

    After a SIGKILL everything is there that was recorded `WRITE_INTERVAL` (plus the time of one write) before; after a
    power cut, `SYNC_INTERVAL` more.
    """

    def __init__(
        self, document: Document, path: Path, folder: Path, lock: FileLock, restored: RestoredSession | None
    ) -> None:
        """Use `begin`."""
        self.folder = folder
        self._document, self._path, self._lock = document, path, lock
        self._sources = get_sources(document)
        self._journal = EditJournal(folder / JOURNAL)
        self._written, self._named = LoggedHistory(), set[str]()
        """What the journal tells; the thread's own."""
        self._replaced, self._is_announced = restored, False
        self._changed = threading.Condition()
        """Guards all below."""
        self._wanted = self._capture_history()
        self._marks: list[dict[str, Any]] = [{"saved": None if restored else self._wanted.cursor}]
        """Lines to be written after the history."""
        self._behind, self._ending = True, False
        self._failure: DataError | None = None
        """Why nothing can be written now."""
        self._failures = 0
        self._problem: DataError | None = None
        """The failure that `take_problem` has not returned yet."""
        self._thread = threading.Thread(target=self._run, name="autosave", daemon=True)

    @classmethod
    def begin(
        cls, document: Document, path: str | Path, *, restored: RestoredSession | None = None, root: Path | None = None
    ) -> Recovery:
        """Start the journal of a document that has just been opened, with what it has done so far.

        Args:
            document: from `open_document`, or `restored`'s.
            path: the scene or project that was opened; names the session for the user.
            restored: where the document was recovered: its old session is removed as soon as this one holds it all.
            root: folder of sessions; default: in the user's state folder.

        Raises DataError where the document comes from no file, or the folder cannot be made.
        """
        get_sources(document)
        root, path = find_session_root(root), Path(path)
        try:
            recovery = cls(document, path, *make_session_folder(root), restored)
        except OSError as error:
            raise _not_written_error(root, error) from error
        recovery._thread.start()
        return recovery

    def record(self) -> None:
        """Note that the document may have changed: call it after each edit, undo, redo and jump, or once a frame.

        Takes microseconds; the thread finds out what is new. `take_problem` returns what the disk refused.
        """
        with self._changed:
            now = self._capture_history()
            if now != self._wanted:
                self._wanted = now
                self._wake()

    def mark_saved(self, path: str | Path, state: ProjectState) -> None:
        """Note that `state` of the document was written to `path`, which names the session from now on."""
        with self._changed:
            self._wanted = self._capture_history()
            done = state.edits[: state.cursor]
            # Undone and edited on meanwhile, the saved state may be none that the journal knows: nothing is saved then.
            is_known = count_shared_edits(done, self._wanted.edits) == len(done)
            mark = {"saved": len(done) if is_known else None, "path": str(Path(path).absolute())}
            self._marks.append(mark)
            self._wake()

    def flush(self, timeout: float = 10.0) -> None:
        """Wait until everything recorded is on the disk. Raises DataError where it cannot be, or takes too long."""
        with self._changed:
            failures = self._failures
            self._changed.wait_for(lambda: not self._behind or self._failures > failures, timeout)
            if self._behind:
                raise self._failure or DataError(self.folder, "autosave does not come to an end", "Save the project")

    def take_problem(self) -> DataError | None:
        """What hindered the journal since the last call, once; None where it is well. To be asked now and then."""
        with self._changed:
            problem, self._problem = self._problem, None
            return problem

    def end(self) -> None:
        """End the session, as the user closed the document: nothing is left to recover. A second call does nothing."""
        self._stop()
        remove_session(self.folder)
        self._lock.release()
        if self._replaced is not None:
            self._replaced.remove()

    def _stop(self) -> None:
        with self._changed:
            self._ending = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()
        self._journal.close()

    def _capture_history(self) -> LoggedHistory:
        return LoggedHistory(self._document.history.edits, self._document.history.cursor)

    def _wake(self) -> None:
        self._behind = True
        self._changed.notify_all()

    def _run(self) -> None:
        next_sync = 0.0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._behind or self._ending)
                if self._ending:
                    return
            try:
                self._write()
                self._announce()
                if time.monotonic() >= next_sync:
                    self._journal.sync()
                    next_sync = time.monotonic() + SYNC_INTERVAL
                    self._note_synced()
            except (OSError, DataError) as error:
                self._note_failure(error)
            with self._changed:
                # Edits that come close after one another become one line.
                self._changed.wait_for(lambda: self._ending, SYNC_INTERVAL if self._failure else WRITE_INTERVAL)

    def _write(self) -> None:
        with self._changed:
            wanted, marks = self._wanted, list(self._marks)
        line = diff_histories(self._written, wanted)
        if line is not None:
            new = {name: source for name, source in dict(self._sources.inserted).items() if name not in self._named}
            if new:
                recorded = {name: record_source(source, self._path) for name, source in new.items()}
                line["inserted"] = {name: source_to_json(source) for name, source in recorded.items()}
            self._journal.append(line)
            self._named |= set(new)
        self._written = wanted
        for mark in marks:
            self._journal.append(mark)
            with self._changed:
                self._marks.remove(mark)

    def _announce(self) -> None:
        """Once: make the folder a session that can be recovered, in place of the one that it goes on with."""
        if self._is_announced:
            return
        self._journal.sync()
        write_session(self.folder, self._path, record_source(self._sources.base, self._path))
        if self._replaced is not None:
            self._replaced.remove()
            self._replaced = None
        self._is_announced = True

    def _note_synced(self) -> None:
        with self._changed:
            self._behind = self._wanted is not self._written or bool(self._marks)
            self._failure = None
            self._changed.notify_all()

    def _note_failure(self, error: OSError | DataError) -> None:
        with self._changed:
            if self._failure is None:
                self._failure = self._problem = _not_written_error(self.folder, error)
            self._failures += 1
            self._changed.notify_all()


def _not_written_error(folder: Path, error: OSError | DataError) -> DataError:
    reason = error.problem if isinstance(error, DataError) else error.strerror or error
    problem = f"edits cannot be kept for recovery ({reason})"
    return DataError(folder, problem, "Save the project, and free some space")
