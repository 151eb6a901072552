"""The files of a scene, and a digest that tells them from others."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.formats.registry import find_format


@dataclass(frozen=True)
class FileIdentity:
    """Digest and size of a scene's files."""

    sha256: str
    """Hexadecimal. For a folder, the digest of one line ``SHA-256 name`` per file, as `sha256sum` prints them."""
    size: int
    """Bytes of all files."""


def list_scene_files(path: Path) -> tuple[Path, ...]:
    """List the files that are read when a scene is opened; for a folder of levels of detail, those of all levels.

    The list is empty for a folder that is no scene. Whether a file is a scene is not checked. Raises DataError where
    the path does not exist.
    """
    if not path.exists():
        raise DataError(path, "there is no such file or folder", "Check the path")
    fmt = find_format(path)
    if fmt is not None and fmt.folder is not None:
        return fmt.folder.list_files(path)
    return (path,) if path.is_file() else ()


def sum_file_sizes(files: tuple[Path, ...]) -> int:
    """Sum the sizes of files in bytes. Raises OSError."""
    return sum(file.stat().st_size for file in files)


def identify_scene(path: Path) -> FileIdentity:
    """Read all files of a scene and digest them. Raises DataError where there is no scene, OSError."""
    files = list_scene_files(path)
    if files == (path,):
        return FileIdentity(_digest(path), path.stat().st_size)
    folder = path if path.is_dir() else path.parent
    lines = "".join(f"{_digest(file)}  {file.relative_to(folder).as_posix()}\n" for file in files)
    return FileIdentity(hashlib.sha256(lines.encode()).hexdigest(), sum_file_sizes(files))


def _digest(file: Path) -> str:
    with require_plain_file(file).open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
