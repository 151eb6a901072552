"""Small text files of others, of bounded length."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file

LONGEST_TEXT = 64 << 20
"""Bytes; poses of an hour's drive are a tenth of it."""
_REMEDY = "Get the file again"


def read_text(file: Path, longest: int = LONGEST_TEXT) -> str:
    """Read a text file of at most `longest` bytes. Raises DataError where it is missing, no text, or longer."""
    try:
        with require_plain_file(file).open("rb") as opened:
            content = opened.read(longest + 1)
    except FileNotFoundError as error:
        raise DataError(file, "is missing", _REMEDY) from error
    except OSError as error:
        raise DataError(file, f"cannot be read ({error})", _REMEDY) from error
    if len(content) > longest:
        raise DataError(file, f"is longer than {longest >> 20} MiB", _REMEDY)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(file, f"is no text ({error})", _REMEDY) from error
