"""JSON files of a data set, with errors that name file and field."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from instdrive_core.errors import DataError
from instdrive_core.files.json_value import parse_json
from instdrive_core.files.plain_file import require_plain_file

_REMEDY = "Get the file again"
_MAX_DIGITS = 9


def read_json(file: Path) -> Any:
    """Read and parse a JSON file. Raises DataError where it is missing or broken."""
    try:
        return parse_json(require_plain_file(file).read_text(encoding="utf-8-sig"))  # Windows programs mark UTF-8
    except FileNotFoundError as error:
        raise DataError(file, "is missing", _REMEDY) from error
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(file, f"is no readable JSON ({error})", _REMEDY) from error


def require_field(file: Path, entry: Any, key: str, where: str = "") -> Any:
    """Return ``entry[key]``. Raises DataError where there is none; `where` precedes the key in the message."""
    if not isinstance(entry, dict) or key not in entry:
        raise DataError(file, f"the field '{where}{key}' is missing", _REMEDY)
    return entry[key]


def require_number(file: Path, value: Any, name: str) -> float:
    """Return a finite number as a float. Raises DataError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise DataError(file, f"the field '{name}' is {value!r}, expected a number", _REMEDY)
    return float(value)


def require_numbers(file: Path, value: Any, name: str) -> list[float]:
    """Return a list of finite numbers as floats. Raises DataError for anything else."""
    if not isinstance(value, list):
        raise DataError(file, f"expected {name}, found {type(value).__name__}", _REMEDY)
    return [require_number(file, entry, f"[{position}]") for position, entry in enumerate(value)]


def parse_whole_number(key: str) -> int:
    """Parse the whole number that a key of an object stands for; JSON has no other keys than text.

    Raises ValueError for anything but a few digits: Python refuses to read thousands of them.
    """
    if not (key.isascii() and key.isdecimal() and len(key) <= _MAX_DIGITS):
        raise ValueError(f"{key[:40]!a} is no whole number of up to {_MAX_DIGITS} digits")
    return int(key)
