"""What can be done with each of the files that were dropped onto the window."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from instdrive_app.files.file_names import find_name_problem
from instdrive_app.panels.dialogs.file_purposes import PURPOSES
from instdrive_core.wording import format_count

_MOST_REPORTED = 3
"""Problems that are told of one drop; of more, their number."""
_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/")
"""How a web page's link begins when it is dropped; a drive's letter is shorter."""


@dataclass(frozen=True)
class DroppedFiles:
    """Files and folders of one drop, in its order."""

    scenes: tuple[Path, ...]
    """Can be opened or inserted."""
    projects: tuple[Path, ...]
    """Can be opened only."""
    openable: tuple[Path, ...]
    """Both."""
    problems: tuple[str, ...]
    """Why the others are left, a sentence each."""

    @property
    def complaint(self) -> str:
        """The problems as one message; empty where there are none."""
        told = list(self.problems[:_MOST_REPORTED])
        if len(self.problems) > _MOST_REPORTED:
            told.append(
                f"So it is with {format_count(len(self.problems) - _MOST_REPORTED, 'other')} of what was dropped"
            )
        return ". ".join(told)


def sort_dropped(paths: Iterable[Path]) -> DroppedFiles:
    """Look at what was dropped."""
    openable, problems = [], []
    for path in dict.fromkeys(paths):
        problem = _find_problem(path)
        if problem:
            problems.append(problem)
        else:
            openable.append(path)
    scenes = [path for path in openable if not PURPOSES["insert"].find_problem(path)]
    projects = [path for path in openable if path not in scenes]
    return DroppedFiles(tuple(scenes), tuple(projects), tuple(openable), tuple(problems))


def _find_problem(path: Path) -> str:
    """Why a path cannot be opened; empty where it can."""
    if find_name_problem(path):
        return find_name_problem(path)
    if not PURPOSES["open"].find_problem(path):
        return ""
    if os.path.isdir(path):
        return f"The folder {path.name or path} holds no scene. Drop a run's folder or one that holds a scene"
    if os.path.exists(path):
        return f"{path.name} is no scene or project that can be opened"
    if _ADDRESS.match(str(path)):
        address = str(path).replace(":/", "://", 1)  # a Path has one slash for two
        return f"{address} is not on this computer. Download it, then drop the file"
    return f"{path} cannot be found. It may have been moved, or must not be read"
