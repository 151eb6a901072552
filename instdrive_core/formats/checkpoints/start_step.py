"""The time step at which drivestudio's training began: its world is the recording's frame of reference there."""

from __future__ import annotations

import re
from pathlib import Path

from instdrive_core.errors import DataError
from instdrive_core.files.torch_checkpoint import open_torch_checkpoint
from instdrive_core.formats.checkpoints.drivestudio import find_models

SETTINGS = "config.yaml"
"""What drivestudio writes beside its checkpoints."""
_START = re.compile(r"^ +start_timestep: *(\d{1,6}) *(?:#.*)?$", re.MULTILINE)
_MOST_BYTES = 1 << 20


def read_start_step(path: Path) -> int | None:
    """Read the first step that a checkpoint of drivestudio saw; None where another trainer wrote it.

    It is `data.start_timestep` of the settings beside the checkpoint, and 0, drivestudio's default, without them.
    Raises DataError where the checkpoint or its settings are damaged.
    """
    file = open_torch_checkpoint(Path(path))
    if find_models(file) is None:
        return None
    settings = file.path.parent / SETTINGS
    if not settings.is_file():
        return 0
    with settings.open("rb") as stream:
        text = stream.read(_MOST_BYTES).decode("utf-8", errors="replace")
    found = _START.search(text)
    if found is None:
        raise DataError(
            settings,
            "names no start_timestep, by which drivestudio places its world",
            "Get the file of the run again, or move it away if the run began at step 0",
        )
    return int(found[1])
