"""What a file's format says about the way up."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.scene.upright import Axis

STATED: dict[str, Axis] = {".spz": "-y"}
"""By ending, in the axes that the file is opened with. An .spz is right, up, back, and opened as right, down, forward;
the other formats say nothing."""


def stated_up(path: Path) -> Axis | None:
    """The axis that points up by the format of this file; None where it says nothing."""
    return next((axis for ending, axis in STATED.items() if path.name.lower().endswith(ending)), None)
