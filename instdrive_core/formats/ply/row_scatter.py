"""Reading a large binary .ply: threads that each read rows and deal their columns to the scene's arrays.

NumPy copies a column at a time, which costs more for each of them than the copying itself.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
from jaxtyping import Int64, UInt32
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.ply_header import REMEDY, PlyHeader
from instdrive_core.files.reader_pool import open_reader_pool
from instdrive_core.formats.ply.columns import ID_LIMITS, check_whole_numbers, view_columns, view_features
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians

LEAST_ROWS = 1 << 18
"""Rows below which threads are not worth it."""
BLOCK_ROWS = 1 << 14
_WORD = 4


@dataclass(frozen=True)
class _Target:
    """An array that takes columns of each row, side by side."""

    words: UInt32[ndarray, "n w"]
    columns: Int64[ndarray, " w"]
    """Columns of the file, in words."""


def can_scatter(header: PlyHeader) -> bool:
    """Whether a file is large, in this machine's byte order, and made of numbers of four bytes alone."""
    if header.is_ascii or header.count < LEAST_ROWS or sys.byteorder != "little":
        return False
    kinds = [header.dtype[name] for name in header.dtype.names or ()]
    floats = all(header.dtype[name] == "<f4" for name in header.dtype.names or () if name not in ID_LIMITS)
    return floats and all(kind in (np.dtype("<f4"), np.dtype("<u4"), np.dtype("<i4")) for kind in kinds)


def scatter_rows(
    path: Path, header: PlyHeader, gaussians: Gaussians, ids: dict[str, ndarray], extra: dict[str, ndarray]
) -> None:
    """Fill the Gaussians, IDs and further columns (n,) of a file for which `can_scatter` holds.

    Raises DataError where the file is short, or an ID is no whole number in range.
    """
    targets = _list_targets(header, gaussians)

    def read_block(start: int) -> int:
        wanted = min(BLOCK_ROWS, header.count - start)
        rows = np.fromfile(path, header.dtype, wanted, offset=header.body_offset + start * header.dtype.itemsize)
        if len(rows) < wanted:
            raise DataError(path, f"the file ends after {start + len(rows)} of {header.count} {header.noun}", REMEDY)
        words = rows.view(np.uint32).reshape(wanted, -1)
        for target in targets:
            _deal(words, target.columns, target.words[start : start + wanted])
        for name, column in (ids | extra).items():
            if name not in (header.dtype.names or ()):
                continue
            if name in ids:
                _check_ids(rows[name], name, path)
            column[start : start + wanted] = rows[name]
        return start + wanted

    with open_reader_pool() as pool:
        for done in pool.map(read_block, range(0, header.count, BLOCK_ROWS)):
            report(done / header.count)


def _list_targets(header: PlyHeader, gaussians: Gaussians) -> list[_Target]:
    """Find which columns each array of the Gaussians takes, in its order: the views of a row numbered like one tell."""
    numbered, place = gaussians.select(slice(0, 1)), {name: k for k, name in enumerate(header.dtype.names or ())}
    for array in numbered.arrays().values():
        array.reshape(1, -1)[:] = -1
    for name, view in (view_columns(numbered) | view_features(numbered)).items():
        view[:] = place[name]
    return [
        _Target(array.reshape(len(array), -1).view(np.uint32), numbers.reshape(-1).astype(np.int64))
        for array, numbers in zip(gaussians.arrays().values(), numbered.arrays().values(), strict=True)
        if numbers.size
    ]


def _check_ids(values: ndarray, name: str, path: Path) -> None:
    if values.dtype.kind == "u" and int(values.max(initial=0)) < ID_LIMITS[name]:
        return
    check_whole_numbers(values, name, path)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _deal(words, columns, target):
    for row in range(len(words)):
        for k in range(len(columns)):
            target[row, k] = words[row, columns[k]]
