"""A folder for what the editor keeps beside projects, so that benchmarks leave the user's recent files alone."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from instdrive_core.files.user_folders import OVERRIDE


@contextmanager
def own_state() -> Iterator[Path]:
    """A temporary folder; meanwhile recent files, autosaves and logs of this process and its children lie in it."""
    before = os.environ.get(OVERRIDE)
    with tempfile.TemporaryDirectory() as folder:
        os.environ[OVERRIDE] = str(Path(folder) / "state")
        try:
            yield Path(folder)
        finally:
            if before is None:
                del os.environ[OVERRIDE]
            else:
                os.environ[OVERRIDE] = before
