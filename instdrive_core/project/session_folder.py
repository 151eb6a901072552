"""The folder of one autosaved document: who edits it, what it came from, and the journal of its edits."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import time
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.files.file_lock import FileLock
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.project.edit_log import ReadLog
from instdrive_core.project.journal import read_journal
from instdrive_core.project.manifest import source_from_json, source_to_json
from instdrive_core.project.sources import RecordedSource

LOCK, SESSION, JOURNAL = "lock", "session.json", "journal.jsonl"
FORMAT_NAME, FORMAT_VERSION = "instdrive recovery", 1
_BAD = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
_WAIT = 0.01
_ATTEMPTS = 200


@dataclass(frozen=True)
class ReadSession:
    """A session as its folder describes it."""

    path: Path
    """Scene or project that the user opened, or saved to since."""
    base: RecordedSource
    inserted: dict[str, RecordedSource]
    log: ReadLog


def make_session_folder(root: Path) -> tuple[Path, FileLock]:
    """A folder for a session, and the lock that tells others that its editor runs. Raises OSError."""
    name = f"{datetime.now():%Y%m%d-%H%M%S}-{os.getpid()}-{secrets.token_hex(3)}"
    folder = root / name
    folder.mkdir(parents=True, mode=0o700)
    for _ in range(_ATTEMPTS):
        lock = FileLock.acquire(folder / LOCK)
        if lock is not None:
            return folder, lock
        time.sleep(_WAIT)  # an editor that has just started looks whether this one is dead
    raise OSError(f"{folder / LOCK} stays locked")


def write_session(folder: Path, path: Path, base: RecordedSource) -> None:
    """Tell what is edited; from here on the session can be recovered. Raises DataError."""
    entry = {
        "format": FORMAT_NAME,
        "version": FORMAT_VERSION,
        "pid": os.getpid(),
        "path": str(path.absolute()),
        "base": source_to_json(base),
    }
    write_bytes(folder / SESSION, (json.dumps(entry, indent=1) + "\n").encode())


def read_session(folder: Path) -> ReadSession:
    """Read the session of a folder: edits up to the first torn line. Raises DataError."""
    try:
        entry = parse_bounded_json(require_plain_file(folder / SESSION).read_bytes())
        if (entry["format"], entry["version"]) != (FORMAT_NAME, FORMAT_VERSION):
            raise ValueError(f"it is of version {entry['version']!r}, this program reads {FORMAT_VERSION}")
        path, base = Path(entry["path"]), source_from_json(entry["base"])
        inserted: dict[str, RecordedSource] = {}
        log = ReadLog()
        for line in read_journal(folder / JOURNAL):
            _take_line(line, log, inserted)
            path = Path(line.get("path", path))
        return ReadSession(path, base, inserted, log)
    except _BAD as error:
        problem = f"the autosaved session cannot be read ({error})"
        raise DataError(folder, problem, "Discard it, or keep the folder and ask for help") from error


def is_session(folder: Path) -> bool:
    """Whether the folder has come so far that it can be recovered."""
    return (folder / SESSION).exists()


def remove_session(folder: Path) -> None:
    """Remove the folder; first what makes it a session, so that half a folder is none. Raises OSError."""
    (folder / SESSION).unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)


def _take_line(line: dict[str, Any], log: ReadLog, inserted: dict[str, RecordedSource]) -> None:
    inserted |= {name: source_from_json(source) for name, source in line.get("inserted", {}).items()}
    if "cursor" in line:
        log.apply_line(line)
    if "saved" in line:
        log.set_saved(line["saved"])
