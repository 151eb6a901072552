"""The zip archive of a project, read without trusting it."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.files.plain_file import require_plain_file

ARCHIVE_REMEDY = "Take an older copy of the project, or what the editor recovers"
MAX_MEMBERS = 100_000
_BAD_ZIP = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, RuntimeError, struct.error)
_SMALL = 16 << 20
_MAX_RATIO = 200
"""Bytes that a compressed byte may become beyond the first `_SMALL`; text of edits gives 5 to 50."""


class Archive:
    """An open archive, read by the names of its members. Every method raises DataError where the file is damaged."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        self.path, self._archive = path, archive
        self._members = {info.filename: info for info in self._check_members(archive.infolist())}

    @property
    def names(self) -> frozenset[str]:
        """Names of all members."""
        return frozenset(self._members)

    def read(self, name: str, limit: int) -> bytes:
        """Read a whole member of at most `limit` bytes and compare its checksum."""
        info = self._find_member(name)
        if info.file_size > limit:
            raise DataError(
                self.path, f"{name!r} holds {info.file_size} bytes, at most {limit} are expected", ARCHIVE_REMEDY
            )
        with self._report_damage(name), self._archive.open(info) as member:
            data = member.read(limit + 1)
            if len(data) != info.file_size:
                raise ValueError(f"it has {len(data)} bytes, not {info.file_size}")
            return data

    @contextmanager
    def open_member(self, name: str) -> Iterator[IO[bytes]]:
        """Open a member, to be read to its end, where its checksum is compared. Refuses one that unfolds too far."""
        info = self._find_member(name)
        if info.file_size > _SMALL + _MAX_RATIO * info.compress_size:
            problem = f"{name!r} would unfold from {info.compress_size} to {info.file_size} bytes"
            raise UntrustedDataError(self.path, problem, "Do not use this file unless you know who made it")
        with self._report_damage(name), self._archive.open(info) as member:
            yield member

    def _find_member(self, name: str) -> zipfile.ZipInfo:
        if name not in self._members:
            raise DataError(self.path, f"the project holds no {name!r}", ARCHIVE_REMEDY)
        return self._members[name]

    def _check_members(self, members: list[zipfile.ZipInfo]) -> list[zipfile.ZipInfo]:
        if len(members) > MAX_MEMBERS:
            raise DataError(
                self.path, f"the archive has {len(members)} members, more than {MAX_MEMBERS}", ARCHIVE_REMEDY
            )
        twice = [name for name, count in Counter(info.filename for info in members).items() if count > 1]
        if twice:
            raise UntrustedDataError(self.path, f"the archive holds {twice[0][:200]!r} twice", ARCHIVE_REMEDY)
        for info in members:
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                problem = f"{info.filename[:200]!r} is compressed by method {info.compress_type}"
                raise DataError(self.path, problem, ARCHIVE_REMEDY)
        return members

    @contextmanager
    def _report_damage(self, name: str) -> Iterator[None]:
        try:
            yield
        except _BAD_ZIP as error:
            raise DataError(self.path, f"{name!r} in the project is damaged ({error})", ARCHIVE_REMEDY) from error


@contextmanager
def open_project_archive(path: Path) -> Iterator[Archive]:
    """Open a project file. Raises DataError where it is no whole zip archive."""
    try:
        archive = zipfile.ZipFile(require_plain_file(path))
    except OSError as error:
        raise DataError(path, f"the project cannot be read ({error.strerror or error})", "Check the path") from error
    except _BAD_ZIP as error:
        raise DataError(path, f"the project is no whole zip archive ({error})", ARCHIVE_REMEDY) from error
    with archive:
        yield Archive(path, archive)


def add_member(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    """Write a member; equal content gives equal bytes."""
    archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
