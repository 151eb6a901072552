"""The vertices of a .ply file, ASCII or binary of either byte order, in chunks of rows."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.ply_header import REMEDY, PlyHeader

CHUNK_ROWS = 1024
"""Rows converted at a time: about 250 kB of splats, so that a chunk and where its columns go lie in a core's own
cache."""
LONGEST_VALUE = 256
"""Bytes of a number in text, with what separates it from the next."""
PIECE = 1 << 16


def read_ply_chunks(file: BinaryIO, header: PlyHeader, path: Path) -> Iterator[ndarray]:
    """Read the vertices as structured arrays of up to `CHUNK_ROWS` rows. Raises DataError for a short file."""
    if header.is_ascii:
        yield from _read_ascii_chunks(file, header, path)
        return
    file.seek(header.body_offset)
    for start in range(0, header.count, CHUNK_ROWS):
        wanted = min(CHUNK_ROWS, header.count - start)
        chunk = np.fromfile(file, header.dtype, wanted)
        if len(chunk) < wanted:
            raise DataError(path, f"the file ends after {start + len(chunk)} of {header.count} {header.noun}", REMEDY)
        yield chunk


def _read_ascii_chunks(file: BinaryIO, header: PlyHeader, path: Path) -> Iterator[ndarray]:
    _skip_lines(file, header.skipped_lines)
    lines = _read_lines(file, LONGEST_VALUE * len(header.dtype.names or ()) + LONGEST_VALUE, path)
    for start in range(0, header.count, CHUNK_ROWS):
        part = list(islice(lines, min(CHUNK_ROWS, header.count - start)))
        if start + len(part) < min(start + CHUNK_ROWS, header.count):
            raise DataError(path, f"the file ends after {start + len(part)} of {header.count} {header.noun}", REMEDY)
        try:
            values = np.loadtxt(part, np.float64, comments=None, ndmin=2)
        except ValueError as error:
            raise DataError(
                path, f"{header.noun} {start} to {start + len(part)} are not numbers ({error})", REMEDY
            ) from error
        names = header.dtype.names or ()
        if values.shape[1] != len(names):
            problem = f"a line holds {values.shape[1]} values, the header promises {len(names)}"
            raise DataError(path, problem, REMEDY)
        chunk = np.empty(len(part), header.dtype)
        for name, column in zip(names, values.T, strict=True):
            if header.dtype[name].kind in "iu":
                _check_integers(column, name, header.dtype[name], path)
            with np.errstate(over="ignore"):  # too large for float32 is infinite, which later checks report
                chunk[name] = column
        yield chunk
    if header.is_last and next(lines, None) is not None:
        problem = f"more lines follow the {header.count} {header.noun} that the header promises"
        raise DataError(path, problem, "The header's count is wrong; export the file again")


def _skip_lines(file: BinaryIO, count: int) -> None:
    """Skip lines of any length, blank ones not counted, as far as there are any."""
    while count and (piece := file.readline(PIECE)):
        is_blank = not piece.strip()
        while piece and not piece.endswith(b"\n"):
            piece = file.readline(PIECE)
            is_blank = is_blank and not piece.strip()
        count -= not is_blank


def _read_lines(file: BinaryIO, longest: int, path: Path) -> Iterator[bytes]:
    """Read lines that are not blank. Raises DataError for a line too long for its values, before it takes memory."""
    while line := file.readline(longest):
        if len(line) == longest and not line.endswith(b"\n"):
            problem = f"a line is longer than {longest:,} bytes, too many for the values that the header promises"
            raise DataError(path, problem, REMEDY)
        if line.strip():
            yield line


def _check_integers(values: ndarray, name: str, dtype: np.dtype, path: Path) -> None:
    """Check for whole numbers: text may promise them and hold others, and a cast would give any number."""
    limits = np.iinfo(dtype)
    wrong = np.flatnonzero(~((values >= limits.min) & (values <= limits.max) & (values == np.floor(values))))
    if len(wrong):
        problem = f"column {name!r} holds {values[wrong[0]]:g}, not a whole number of the type in the header"
        raise DataError(path, problem, REMEDY)
