"""The editor's log file: warnings, failures and their tracebacks."""

from __future__ import annotations

import logging
import sys
import threading
from logging.handlers import RotatingFileHandler
from pathlib import Path

from instdrive_core.files.user_folders import find_state_folder

MAX_BYTES, BACKUPS = 1_000_000, 4
"""Size of one file, and the number of older ones that are kept."""
_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


def get_log_path() -> Path:
    """Get the path of the newest log."""
    return find_state_folder() / "logs" / "editor.log"


def start_logging(path: Path | None = None) -> logging.Handler | None:
    """Write warnings and log messages to the log file, including failures in threads that nobody waits for.

    Returns None, with a warning on stderr, where the file cannot be written; the editor works without a log.
    """
    path = path or get_log_path()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # File names need not be text: a failure that names one is logged all the same.
        handler = RotatingFileHandler(
            path, maxBytes=MAX_BYTES, backupCount=BACKUPS, encoding="utf-8", errors="backslashreplace"
        )
    except OSError as error:
        print(f"instdrive: the log {path} cannot be written ({error}); continuing without a log", file=sys.stderr)
        return None
    handler.setFormatter(logging.Formatter(_FORMAT))
    root = logging.getLogger()
    root.addHandler(handler)
    logging.getLogger("instdrive_app").setLevel(logging.INFO)
    logging.getLogger("instdrive_core").setLevel(logging.INFO)
    logging.captureWarnings(True)
    threading.excepthook = _log_thread_failure
    return handler


def _log_thread_failure(failure: threading.ExceptHookArgs) -> None:
    if failure.exc_value is None or isinstance(failure.exc_value, SystemExit):
        return
    name = failure.thread.name if failure.thread else "a thread"
    logging.getLogger("instdrive_app").error("%s failed", name, exc_info=failure.exc_value)
    threading.__excepthook__(failure)
