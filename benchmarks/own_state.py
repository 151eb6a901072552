"""A folder for what the editor keeps beside projects, so that benchmarks leave the user's files alone."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from instdrive_core.files.user_folders import OVERRIDE

HOME = "HOME"
"""Environment variable below which documents and pictures are proposed."""


@contextmanager
def own_state() -> Iterator[Path]:
    """A temporary folder; meanwhile recent files, autosaves, logs and documents of this process and its children lie in
    it."""
    before = {name: os.environ.get(name) for name in (OVERRIDE, HOME)}
    with tempfile.TemporaryDirectory() as folder:
        os.environ[OVERRIDE], os.environ[HOME] = str(Path(folder) / "state"), folder
        try:
            yield Path(folder)
        finally:
            for name, value in before.items():
                os.environ.pop(name, None)
                if value is not None:
                    os.environ[name] = value
