"""Sorts dropped files by what can be done with them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from instdrive_app.files.file_names import find_name_problem
from instdrive_app.panels.dialogs.file_purposes import PURPOSES
from instdrive_core.wording import format_count, phrase

_MOST_REPORTED = 3
"""Problems of one drop that are spelled out; further ones are only counted."""
_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/")
"""Matches the beginning of a link dropped from a web browser; a Windows drive has only one letter."""


@dataclass(frozen=True)
class DroppedFiles:
    """The files and folders of one drop, in its order."""

    scenes: tuple[Path, ...]
    """Can be opened or inserted."""
    projects: tuple[Path, ...]
    """Can be opened only."""
    openable: tuple[Path, ...]
    """Scenes and projects together."""
    problems: tuple[str, ...]
    """Why the other files cannot be opened, one sentence each."""

    @property
    def complaint(self) -> str:
        """All problems in one message; empty if there are none."""
        sentences = list(self.problems[:_MOST_REPORTED])
        if len(self.problems) > _MOST_REPORTED:
            rest = format_count(len(self.problems) - _MOST_REPORTED, "other")
            sentences.append(phrase("{rest} cannot be opened either", rest=rest))
        parts = {f"part{number}": phrase(text) for number, text in enumerate(sentences)}
        return phrase(". ".join(f"{{{name}}}" for name in parts), **parts)


def sort_dropped(paths: Iterable[Path]) -> DroppedFiles:
    """Sort dropped paths into scenes, projects and problems; repeated paths count once."""
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
    """Why a path cannot be opened; empty if it can."""
    if find_name_problem(path):
        return find_name_problem(path)
    if not PURPOSES["open"].find_problem(path):
        return ""
    if os.path.isdir(path):
        return phrase(
            "The folder {name} contains no scene. Drop a training run's folder or a scene folder",
            name=path.name or path,
        )
    if os.path.exists(path):
        return phrase("{name} is not a scene or project that can be opened", name=path.name)
    if _ADDRESS.match(str(path)):
        address = str(path).replace(":/", "://", 1)  # a Path has one slash for two
        return phrase("{address} is not on this computer. Download it, then drop the file", address=address)
    return phrase("{path} was not found. It may have been moved, or you may not be allowed to read it", path=path)
