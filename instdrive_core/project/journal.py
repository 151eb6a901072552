"""A file that only grows, of JSON lines with checksums: what is whole of it is kept, whatever cut it off."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from instdrive_core.files.json_value import parse_json
from instdrive_core.files.plain_file import require_plain_file

_CHECKSUM = 8
"""Hexadecimal digits before each line, and a space."""


class EditJournal:
    """Appends lines. Every method raises OSError where the disk refuses; what was written before stays whole."""

    def __init__(self, path: Path) -> None:
        flags = os.O_CREAT | os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0)
        self._descriptor = os.open(path, flags, 0o600)
        self._end = os.fstat(self._descriptor).st_size

    def append(self, entry: dict[str, Any]) -> None:
        """Hand a line to the system: it survives this process from here on, and a power cut from the next `sync`."""
        text = json.dumps(entry, separators=(",", ":")).encode()
        line = b"%0*x %s\n" % (_CHECKSUM, zlib.crc32(text), text)
        try:
            rest = memoryview(line)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError:
            # Lines after half a line would be lost with it.
            os.ftruncate(self._descriptor, self._end)
            raise
        self._end += len(line)

    def sync(self) -> None:
        """Wait until all lines are on the disk."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Done twice, it changes nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def read_journal(path: Path) -> Iterator[dict[str, Any]]:
    """The lines up to the first that is torn or damaged. Raises OSError where the file cannot be read."""
    with require_plain_file(path).open("rb") as file:
        for line in file:
            checksum, _, text = line[:-1].partition(b" ")
            if not line.endswith(b"\n") or checksum != b"%0*x" % (_CHECKSUM, zlib.crc32(text)):
                return
            yield parse_json(text)
