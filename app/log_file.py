"""The editor's log on disk: what was told to the user, and the tracebacks that were spared them."""

from __future__ import annotations

import logging
import sys
import threading
from logging.handlers import RotatingFileHandler
from pathlib import Path

from instdrive_core.files.user_folders import find_state_folder

MAX_BYTES, KEPT = 1_000_000, 4
"""Size of one file, and how many older ones are kept."""
_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"


def get_log_path() -> Path:
    """The newest log."""
    return find_state_folder() / "logs" / "editor.log"


def start_logging(path: Path | None = None) -> logging.Handler | None:
    """Write warnings and what the program logs to the log file, also failures in threads that nobody waits for.

    Returns None, with a warning on stderr, where the file cannot be written: the editor works without.
    """
    path = path or get_log_path()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # File names need not be text: a failure that names one is logged all the same.
        handler = RotatingFileHandler(
            path, maxBytes=MAX_BYTES, backupCount=KEPT, encoding="utf-8", errors="backslashreplace"
        )
    except OSError as error:
        print(f"instdrive: the log {path} cannot be written ({error}); going on without one", file=sys.stderr)
        return None
    handler.setFormatter(logging.Formatter(_FORMAT))
    root = logging.getLogger()
    root.addHandler(handler)
    logging.getLogger("instdrive_app").setLevel(logging.INFO)
    logging.getLogger("instdrive_core").setLevel(logging.INFO)
    logging.captureWarnings(True)
    threading.excepthook = _log_thread_failure
    return handler


def stop_logging(handler: logging.Handler) -> None:
    """Undo `start_logging`."""
    logging.getLogger().removeHandler(handler)
    handler.close()
    logging.captureWarnings(False)
    threading.excepthook = threading.__excepthook__


def _log_thread_failure(failure: threading.ExceptHookArgs) -> None:
    if failure.exc_value is None or isinstance(failure.exc_value, SystemExit):
        return
    name = failure.thread.name if failure.thread else "a thread"
    logging.getLogger("instdrive_app").error("%s failed", name, exc_info=failure.exc_value)
    threading.__excepthook__(failure)
