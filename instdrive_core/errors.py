"""Every error that a user can meet. Each message names the thing, the value found and what to do about it."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.wording import Phrase, phrase


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
        said = phrase("{path}: {problem}. {remedy}", path=path, problem=phrase(problem), remedy=phrase(remedy))
        super().__init__(said)
        self.path, self.problem, self.remedy = Path(path), problem, remedy


class SceneTooLargeError(DataError):
    """A scene needs more memory than there is; nothing of it was loaded.

    Args:
        path: the scene.
        count: its splats.
        needed: bytes to open it whole.
        available: bytes that there are.
        keep_every: the smallest k for which every k-th splat fits; None where no share of it does.
    """

    def __init__(self, path: str | Path, count: int, needed: float, available: float, keep_every: int | None) -> None:
        self.count, self.needed, self.available, self.keep_every = count, needed, available, keep_every
        problem = (
            f"it has {count:,} splats and needs {format_gigabytes(needed)}, {format_gigabytes(available)} are free"
        )
        every = (
            ""
            if keep_every is None
            else f"open every {format_ordinal(keep_every)} splat (--keep-every {keep_every}), or "
        )
        remedy = f"{every}close other programs, or use a machine with more memory"
        super().__init__(path, problem, remedy[0].upper() + remedy[1:])


def format_gigabytes(size: float) -> str:
    """Write bytes as a person says them, e.g. ``48 GB`` or ``0.3 GB``."""
    return (
        f"{size / 1e9:.0f} GB" if size >= 9.95e9 else f"{size / 1e9:.1f} GB" if size >= 5e7 else f"{size / 1e6:.1f} MB"
    )


def format_ordinal(number: int) -> str:
    """Write an ordinal number: ``2nd``, ``3rd``, ``11th``."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def say_ordinal(number: int) -> Phrase:
    """The ordinal number as a phrase, since languages write it in different ways."""
    form = {
        "th": phrase("{number}th"),
        "st": phrase("{number}st"),
        "nd": phrase("{number}nd"),
        "rd": phrase("{number}rd"),
    }
    return phrase(form[format_ordinal(number)[-2:]], number=number)


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
        problem = phrase(
            "the scene {scene} has changed since it was edited (SHA-256 {found}, not {expected})",
            scene=scene,
            found=found,
            expected=expected,
        )
        remedy = phrase(
            "Put the old scene back, or open it anyway (accept_changed): edits that no longer fit are left out"
        )
        super().__init__(path, problem, remedy)
        self.scene, self.expected, self.found = Path(scene), expected, found
