"""File names as the user reads them."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Sequence
from importlib import resources
from itertools import count
from pathlib import Path

from instdrive_core.wording import Phrase, format_count, list_phrases, phrase

NAMED = 3
"""Number of files listed by name; the others are counted."""


def is_displayable(path: Path) -> bool:
    """Whether the path is UTF-8 text and can be shown; on Linux names are bytes of any encoding."""
    return str(path) == format_path(path)


def format_path(path: Path | str) -> str:
    """Format the path, with U+FFFD for bytes that are no text."""
    return os.fsencode(path).decode("utf-8", "replace")


def find_name_problem(path: Path) -> str:
    """Say why a path cannot be shown in recent files, titles and messages; empty where it can."""
    if is_displayable(path):
        return ""
    return phrase(
        "{name} cannot be opened: its path is not UTF-8 text. Rename it, then try again",
        name=format_path(path.name or path),
    )


def find_working_folder() -> Path:
    """Find the folder where the program was started; the user's home where that is gone or cannot be shown."""
    try:
        folder = Path.cwd()
    except OSError:
        return Path.home()
    return folder if is_displayable(folder) else Path.home()


def find_documents_folder() -> Path:
    """Find the folder of the user's documents, as the desktop names it; the user's home where there is none."""
    return _find_user_folder("DOCUMENTS", "Documents") or Path.home()


def find_pictures_folder() -> Path:
    """Find the folder of the user's pictures, as the desktop names it; that of documents where there is none."""
    return _find_user_folder("PICTURES", "Pictures") or find_documents_folder()


def find_free_path(folder: Path, stem: str, suffix: str, taken: Collection[Path] = ()) -> Path:
    """Find the first path ``stem_001.suffix``, ``stem_002.suffix`` … that no file has and that is not `taken`."""
    paths = (folder / f"{stem}_{number:03d}{suffix}" for number in count(1))
    return next(path for path in paths if path not in taken and not os.path.lexists(path))


def _find_user_folder(name: str, usual: str) -> Path | None:
    """Find a folder by its name in the desktop's settings, else by its usual one; None where neither is there."""
    config = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "user-dirs.dirs"
    try:
        named = re.search(rf'^XDG_{name}_DIR="([^"]+)"', config.read_text(encoding="utf-8"), re.MULTILINE)
    except (OSError, UnicodeDecodeError):
        named = None
    folders = [Path(named[1].replace("$HOME", str(Path.home())))] if named else []
    found = next((folder for folder in (*folders, Path.home() / usual) if os.path.isdir(folder)), None)
    return found if found is not None and is_displayable(found) else None


def find_folder_beside(path: Path | None) -> Path:
    """Find the folder that a new file beside `path` goes to; never one inside the program, where the sample lies."""
    if path is None:
        return find_working_folder()
    folder, assets = path.resolve().parent, Path(str(resources.files("instdrive_app.assets"))).resolve()
    return find_documents_folder() if folder.is_relative_to(assets) else folder


def join_names(paths: Sequence[Path]) -> Phrase:
    """Join file names, e.g. ``a.ply``, ``a.ply and b.ply``, ``a.ply, b.ply, c.ply and 4 others``."""
    names = [path.name for path in paths]
    if len(names) > NAMED + 1:
        names = [*names[:NAMED], format_count(len(names) - NAMED, "other")]
    if len(names) == 1:
        return phrase("{name}", name=names[0])
    return phrase("{first} and {last}", first=list_phrases(names[:-1]), last=names[-1])


def list_choices(names: Sequence[str]) -> Phrase:
    """Join what can be chosen: ``.png``, ``.png or .jpg``."""
    if len(names) == 1:
        return phrase("{name}", name=names[0])
    return phrase("{first} or {last}", first=list_phrases(names[:-1]), last=names[-1])
