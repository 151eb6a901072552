"""Where the program keeps what belongs to the user and not to a project: logs, recovery journals, recent files."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from platformdirs import PlatformDirs

OVERRIDE = "INSTDRIVE_STATE"
"""Environment variable that names the folder: for tests, and for machines where the usual place cannot be written."""


def find_state_folder() -> Path:
    """Find the program's state folder, where the platform wants it; it may not exist yet.

    Linux: ``$XDG_STATE_HOME/instdrive``, by default ``~/.local/state/instdrive`` (XDG Base Directory Specification).
    macOS: ``~/Library/Application Support/InstDrive``. Windows: ``%LOCALAPPDATA%\\InstDrive``.
    """
    if given := os.environ.get(OVERRIDE):
        return Path(given)
    if sys.platform == "darwin":
        # Version 0.1.0 did not ask for XDG_STATE_HOME here; its journals are still found.
        used = Path.home() / "Library" / "Application Support" / "InstDrive"
        if used.is_dir():
            return used
    name = "InstDrive" if sys.platform in ("darwin", "win32") else "instdrive"
    return PlatformDirs(name, appauthor=False).user_state_path
