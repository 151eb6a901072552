"""The parts of a SOG scene, in a folder or a zip archive, read without trusting them."""

from __future__ import annotations

import struct
import zipfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any, final

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.files.json_value import parse_json
from instdrive_core.files.plain_file import require_plain_file

REMEDY = "Copy the scene again with all its files, or export it again"
_MAX_JSON_BYTES = 16 << 20
_BAD_IMAGE = (OSError, ValueError, SyntaxError, Image.DecompressionBombError, Image.DecompressionBombWarning)
BAD_MEMBER = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, RuntimeError, struct.error)


class Store(ABC):
    """The files of one scene, read by the relative names that its JSON gives."""

    path: Path
    """The folder or archive, for messages."""

    @abstractmethod
    def _read(self, name: str, limit: int) -> bytes:
        """Read at most `limit` + 1 bytes of a file whose name is checked. Raises DataError where there is none."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Bytes of all files that can be read, compressed."""

    def read(self, name: Any, limit: int) -> bytes:
        """Read a whole file of at most `limit` bytes.

        Raises DataError where it is absent or larger, UntrustedDataError where the name leads elsewhere.
        """
        data = self._read(check_member_name(name, self.path), limit)
        if len(data) > limit:
            raise DataError(self.path, f"{name!r} holds more than {limit} bytes, too many for its content", REMEDY)
        return data

    def read_json(self, name: str) -> dict[str, Any]:
        """Read a JSON object. Raises DataError where the file is none."""
        try:
            content = parse_json(self.read(name, _MAX_JSON_BYTES))
        except (ValueError, RecursionError) as error:
            raise DataError(self.path, f"{name!r} is no JSON ({error})", REMEDY) from error
        if not isinstance(content, dict):
            raise DataError(self.path, f"{name!r} holds a {type(content).__name__}, not an object", REMEDY)
        return content

    def read_pixels(self, name: Any, least: int, most: int) -> UInt8[ndarray, "h w 4"]:
        """Read a lossless image as RGBA. Raises DataError for fewer than `least` or more than `most` pixels."""
        data = self.read(name, 5 * most + 4096)
        try:
            _check_pixels(_read_webp_size(data), least, most)
            with Image.open(BytesIO(data), formats=("WEBP", "PNG")) as image:
                _check_pixels(image.size, least, most)
                return np.asarray(image.convert("RGBA"))
        except _BAD_IMAGE as error:
            raise DataError(self.path, f"image {name!r} cannot be used ({error})", REMEDY) from error


@final
class FolderStore(Store):
    """Files beside each other."""

    def __init__(self, folder: Path) -> None:
        self.path = folder

    @property
    def size(self) -> int:
        return sum(entry.stat().st_size for entry in self.path.iterdir() if entry.is_file())

    def _read(self, name: str, limit: int) -> bytes:
        path = self.path / name
        # Not through devices and pipes, which never end.
        if not path.is_file():
            raise DataError(self.path, f"the file {name!r} is missing", REMEDY)
        with path.open("rb") as file:
            return file.read(limit + 1)


@final
class ZipStore(Store):
    """Members of an archive, which are never unpacked to the disk."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self.path, self._archive = path, archive

    @property
    def names(self) -> frozenset[str]:
        """Names of all members."""
        return frozenset(self._archive.namelist())

    @property
    def compressed_names(self) -> tuple[str, ...]:
        """Names of the members that are not stored as they are."""
        return tuple(info.filename for info in self._archive.infolist() if info.compress_type != zipfile.ZIP_STORED)

    @property
    def size(self) -> int:
        return self.path.stat().st_size

    def _read(self, name: str, limit: int) -> bytes:
        try:
            info = self._archive.getinfo(name)
        except KeyError:
            raise DataError(self.path, f"the archive holds no {name!r}", REMEDY) from None
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            problem = f"{name!r} is compressed by method {info.compress_type}, neither stored nor deflated"
            raise DataError(self.path, problem, REMEDY)
        try:
            with self._archive.open(info) as member:
                return member.read(limit + 1)
        except BAD_MEMBER as error:
            raise DataError(self.path, f"{name!r} in the archive is damaged ({error})", REMEDY) from error


@contextmanager
def open_sog_archive(path: Path) -> Iterator[ZipStore]:
    """Open the members of a .sog. Raises DataError where it is no zip archive."""
    try:
        archive = zipfile.ZipFile(require_plain_file(path))
    except BAD_MEMBER as error:
        raise DataError(path, f"the file is no whole zip archive ({error})", REMEDY) from error
    with archive:
        yield ZipStore(path, archive)


def check_member_name(name: Any, path: Path) -> str:
    """Check a name relative to the scene's folder. Raises UntrustedDataError where it leads out of it."""
    if not isinstance(name, str) or not name:
        raise DataError(path, f"{name!r} stands where a file's name should", REMEDY)
    parts = PurePosixPath(name)
    if parts.is_absolute() or ".." in parts.parts or any(sign in name for sign in "\\:\0") or not parts.parts:
        problem = f"the file name {name[:200]!r} leads out of the scene's folder"
        raise UntrustedDataError(path, problem, "Do not use this file unless you know who made it")
    return parts.as_posix()


def _check_pixels(size: tuple[int, int] | None, least: int, most: int) -> None:
    if size is not None and not least <= size[0] * size[1] <= most:
        raise ValueError(f"it has {size[0]} × {size[1]} pixels, expected {least} to {most} in all")


def _read_webp_size(data: bytes) -> tuple[int, int] | None:
    """Read the width and height that a WebP header promises, before a decoder takes memory; None for other files.

    Raises ValueError where the image is compressed with losses, which would change every value.
    """
    if data[:4] != b"RIFF" or data[8:12] != b"WEBP" or len(data) < 30:
        return None
    if data[12:16] == b"VP8 ":
        raise ValueError("it is compressed with losses, which changes the values it holds")
    if data[12:16] == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    return int.from_bytes(data[24:27], "little") + 1, int.from_bytes(data[27:30], "little") + 1
