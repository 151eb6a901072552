"""Sessions of editors that died, for the next editor to offer."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from instdrive_core.edits.document.document import Document
from instdrive_core.errors import DataError
from instdrive_core.files.file_lock import FileLock
from instdrive_core.files.user_folders import find_state_folder
from instdrive_core.project.replay import KeptHistory, replay_history
from instdrive_core.project.session_folder import (
    JOURNAL,
    LOCK,
    SESSION,
    is_session,
    read_session,
    remove_session,
)

_JUNK_AGE = 3600.0
"""Seconds after which a folder without a journal is removed; until then its editor may be about to lock it."""


@dataclass(frozen=True)
class RecoverableSession:
    """A document whose editor died with work that no file holds."""

    folder: Path
    path: Path
    """The scene or project that was opened, or saved to last."""
    changed: datetime
    """When the last edit was kept; local time with its zone."""
    edits: int
    """How many changes no file holds; selecting is none."""
    problem: str = ""
    """Why it cannot be restored; empty where it can."""

    @property
    def title(self) -> str:
        """What to call it: the file's name."""
        return self.path.name


@dataclass(frozen=True)
class RestoredSession:
    """A recovered document. Its old session stays until `Recovery.begin` is given this object."""

    document: Document
    path: Path
    """The scene or project that it was opened from, or saved to last."""
    notes: tuple[str, ...]
    """Edits that were left out, in sentences for the user."""
    _folder: Path
    _lock: FileLock

    def remove(self) -> None:
        """Remove the old session: another holds it all. Raises OSError."""
        remove_session(self._folder)
        self._lock.release()


def find_session_root(root: Path | None = None) -> Path:
    """The folder of all sessions of this user, unless another is named."""
    return find_state_folder() / "recovery" if root is None else root


def find_pending_sessions(root: Path | None = None) -> list[RecoverableSession]:
    """Sessions of editors that no longer run and have unsaved edits, the latest first; the others' are cleared away."""
    root = find_session_root(root)
    folders = [folder for folder in root.iterdir() if folder.is_dir()] if root.is_dir() else []
    found = [session for folder in folders if (session := _inspect_folder(folder)) is not None]
    return sorted(found, key=lambda session: session.changed, reverse=True)


def restore_session(session: RecoverableSession, accept_changed: bool = False) -> RestoredSession:
    """Open the scene of a session and do its edits again; the session stays, locked, until a new one holds its edits.

    Args:
        session: from `find_pending_sessions`.
        accept_changed: as for `open_project`.

    Raises DataError where it is taken by another editor or cannot be read, SceneChangedError for another scene.
    """
    lock = _lock_session(session.folder)
    try:
        read = read_session(session.folder)
        entries = read.log.unpack_entries()
        kept = KeptHistory(read.path, read.base, read.inserted, read.log.cursor, lambda _: entries)
        document, notes = replay_history(kept, accept_changed)
    except BaseException:
        lock.release()
        raise
    return RestoredSession(document, read.path, notes, session.folder, lock)


def discard_session(session: RecoverableSession) -> None:
    """Remove a session for good. Raises DataError where another editor has taken it or it cannot be removed."""
    lock = _lock_session(session.folder)
    try:
        remove_session(session.folder)
    except OSError as error:
        raise DataError(session.folder, f"it cannot be removed ({error.strerror})", "Remove it by hand") from error
    finally:
        lock.release()


def _lock_session(folder: Path) -> FileLock:
    lock = FileLock.acquire(folder / LOCK) if is_session(folder) else None
    if lock is None:
        raise DataError(folder, "another editor has taken this session", "Look for the document there")
    return lock


def _inspect_folder(folder: Path) -> RecoverableSession | None:
    """The session of a folder; None where its editor runs, or nothing would be lost with it."""
    try:
        lock = FileLock.acquire(folder / LOCK)
    except OSError:  # removed just now, or somebody else's
        return None
    if lock is None:
        return None
    try:
        if not is_session(folder):
            _remove_junk(folder)
            return None
        read = read_session(folder)
        if read.log.unsaved:
            return RecoverableSession(folder, read.path, _find_change_time(folder), read.log.unsaved)
        remove_session(folder)
    except DataError as error:
        return RecoverableSession(folder, folder, _find_change_time(folder), 0, str(error))
    finally:
        lock.release()
    return None


def _remove_junk(folder: Path) -> None:
    # A journal is made under the lock: who made it is dead.
    if (folder / JOURNAL).exists() or datetime.now().timestamp() - folder.stat().st_mtime > _JUNK_AGE:
        remove_session(folder)


def _find_change_time(folder: Path) -> datetime:
    for name in (JOURNAL, SESSION):
        if (folder / name).exists():
            return datetime.fromtimestamp((folder / name).stat().st_mtime).astimezone()
    return datetime.fromtimestamp(folder.stat().st_mtime).astimezone()
