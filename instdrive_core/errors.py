"""Every error a user can meet. Each message names the thing, the value found and what to do about it."""

from __future__ import annotations

from pathlib import Path


class InstDriveError(Exception):
    """Base of all errors that are the user's to read: the command line prints them without a traceback."""


class DataError(InstDriveError):
    """A file or folder does not hold what it should.

    Args:
        path: the file or folder at fault.
        problem: what is wrong, with field and value, e.g. ``"column 'opacity' is missing"``.
        remedy: what the user can do.
    """

    def __init__(self, path: str | Path, problem: str, remedy: str) -> None:
        super().__init__(f"{path}: {problem}. {remedy}")
        self.path, self.problem, self.remedy = Path(path), problem, remedy


class UntrustedDataError(DataError):
    """A file asks for something that only a hostile file would ask for; nothing of it was executed."""


class OptionError(InstDriveError):
    """An option given by the user cannot be used, e.g. an unknown camera name or instance ID."""


class EditError(InstDriveError):
    """An edit cannot be applied to this scene; the scene is unchanged."""


class SceneChangedError(DataError):
    """A project's or an autosave's scene file is no longer the one that was edited.

    Args:
        path: the project file, or the scene where there is none.
        scene: the scene as it was found.
        expected: SHA-256 of what was edited.
        found: SHA-256 of what is there now.
    """

    def __init__(self, path: str | Path, scene: str | Path, expected: str, found: str) -> None:
        problem = f"the scene {scene} has changed since it was edited (SHA-256 {found}, not {expected})"
        remedy = "Put the old scene back, or open with accept_changed, which leaves out edits that no longer fit"
        super().__init__(path, problem, remedy)
        self.scene, self.expected, self.found = Path(scene), expected, found
