"""Point clouds as .ply files: positions and colours, by property name; ASCII and both byte orders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from instdrive_core.datasets.posed_photos import ListedPoints, check_points
from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file

_REMEDY = "Export the points again"
_MAX_HEADER = 1 << 16
_LONGEST_VALUE = 256
"""Bytes of a number in text; no memory is taken for lines far longer than their numbers can be."""
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_KINDS = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_COLORS = ("red", "green", "blue")


@dataclass(frozen=True)
class _Header:
    """Where the points begin and what one looks like."""

    order: str
    count: int
    columns: tuple[tuple[str, str], ...]
    size: int
    is_all: bool
    """Whether nothing follows the points."""

    @property
    def dtype(self) -> np.dtype:
        return np.dtype([(name, self.order + kind) for name, kind in self.columns])


def read_point_ply(path: Path) -> ListedPoints:
    """Positions and 8-bit colours of the first element, which must be the vertices; grey where there are no colours.

    Raises DataError where anything about the file is wrong.
    """
    try:
        with require_plain_file(path).open("rb") as file:
            header = _header(file, path)
            rows = _rows(file, header, path)
    except OSError as error:
        raise DataError(path, f"cannot be read ({error})", _REMEDY) from error
    with np.errstate(invalid="ignore"):  # NaN of every kind is found below
        points = np.stack([rows[axis] for axis in "xyz"], axis=1).astype(np.float64)
    check_points(path, points)
    return ListedPoints(points, _colors(rows, header))


def _header(file: BinaryIO, path: Path) -> _Header:
    text = file.read(_MAX_HEADER)
    end = text.find(b"end_header\n")
    if not text.startswith(b"ply") or end < 0:
        raise DataError(path, "does not begin with the header of a .ply file", _REMEDY)
    order, count, columns, elements = "", -1, [], 0
    for line in text[:end].decode("utf-8", errors="replace").splitlines()[1:]:
        match line.split():
            case ["format", name, "1.0"] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, number] if number.isascii() and number.isdigit() and len(number) < 19:
                elements += 1
                if elements == 1 and name == "vertex":
                    count = int(number)
            case ["property", kind, name] if elements == 1 and kind in _KINDS:
                columns.append((name, _KINDS[kind]))
            case ["property", *_] if elements > 1:
                continue
            case ["comment" | "obj_info", *_] | []:
                continue
            case _:
                raise DataError(path, f"the header line {line[:80]!r} is not understood", _REMEDY)
    names = [name for name, _ in columns]
    if not order or count < 0 or not {"x", "y", "z"} <= set(names) or len(set(names)) < len(names):
        problem = f"the header describes no points first: format {order!r}, {count} vertices, properties {names}"
        raise DataError(path, problem, _REMEDY)
    return _Header(order, count, tuple(columns), end + len(b"end_header\n"), elements == 1)


def _rows(file: BinaryIO, header: _Header, path: Path) -> ndarray:
    """The points, one record each; the count is held against the file's length first."""
    left = path.stat().st_size - header.size
    is_text = header.order == "="
    needed = header.count * (2 * len(header.columns) if is_text else header.dtype.itemsize) - is_text
    if left < needed:
        problem = f"the header promises {header.count} points, at least {needed} bytes; {left} are left"
        raise DataError(path, problem, _REMEDY)
    if header.is_all and not is_text and left > needed:
        raise DataError(
            path, f"{left - needed} bytes follow the {header.count} points that the header promises", _REMEDY
        )
    file.seek(header.size)
    if not is_text:
        return np.frombuffer(file.read(needed), header.dtype, header.count)
    rows = np.zeros(header.count, header.dtype)
    longest = _LONGEST_VALUE * (len(header.columns) + 1)
    for row in range(header.count):
        words = file.readline(longest).split()
        try:
            if len(words) != len(header.columns):
                raise ValueError(f"{len(words)} values for {len(header.columns)} properties")
            rows[row] = tuple(
                float(word) if kind[0] == "f" else int(word)
                for word, (_, kind) in zip(words, header.columns, strict=True)
            )
        except (ValueError, OverflowError) as error:
            raise DataError(path, f"point {row} cannot be read ({error})", _REMEDY) from error
    if header.is_all and file.read(1 << 20).strip():
        raise DataError(path, f"more follows the {header.count} points that the header promises", _REMEDY)
    return rows


def _colors(rows: ndarray, header: _Header) -> UInt8[ndarray, "n 3"]:
    kinds = dict(header.columns)
    if not all(name in kinds for name in _COLORS):
        return np.full((len(rows), 3), 128, np.uint8)
    colors = np.stack([rows[name].astype(np.float64) for name in _COLORS], axis=1)
    if kinds["red"][0] == "f":
        colors = np.nan_to_num(colors) * 255
    return np.clip(np.round(colors), 0, 255).astype(np.uint8)
