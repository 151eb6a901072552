"""Where the program keeps what belongs to the user and not to a project: logs, recovery journals, recent files."""

from __future__ import annotations

import os
import sys
from pathlib import Path

OVERRIDE = "INSTDRIVE_STATE"
"""Environment variable that names the folder: for tests, and for machines where the usual place cannot be written."""


def find_state_folder() -> Path:
    """The program's state folder, where the platform wants it; it may not exist yet.

    Linux: ``$XDG_STATE_HOME/instdrive``, by default ``~/.local/state/instdrive`` (XDG Base Directory Specification).
    """
    if given := os.environ.get(OVERRIDE):
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "InstDrive"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "InstDrive"
    base = os.environ.get("XDG_STATE_HOME", "")
    # The specification wants relative paths to be passed over.
    return (Path(base) if base.startswith("/") else Path.home() / ".local" / "state") / "instdrive"
