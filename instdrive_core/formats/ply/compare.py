"""Comparing a .ply with a scene bit by bit, a chunk at a time, in the memory of a chunk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.files.ply_header import read_ply_header
from instdrive_core.files.ply_rows import read_ply_chunks
from instdrive_core.formats.ply.inria import collect_columns
from instdrive_core.progress import report
from instdrive_core.scene.scene import Scene


def find_changed_value(path: Path, scene: Scene) -> str:
    """Find the first value by which a file written by `write_ply` differs from the scene; empty where none does.

    Raises DataError where the file cannot be read.
    """
    columns = collect_columns(scene)
    with path.open("rb") as file:
        header = read_ply_header(file, path, path.stat().st_size)
        if header.count != len(scene):
            return f"{header.count:,} splats came back of {len(scene):,}"
        if header.dtype.names != tuple(columns):
            return f"the columns are {', '.join(header.dtype.names or ())}, not {', '.join(columns)}"
        start = 0
        for chunk in read_ply_chunks(file, header, path):
            for name, column in columns.items():
                found, wanted = chunk[name], column[start : start + len(chunk)]
                if found.tobytes() != wanted.tobytes():
                    return _describe_change(name, start, found, wanted)
            start += len(chunk)
            report(start / len(scene))
    return ""


def _describe_change(name: str, start: int, found: ndarray, wanted: ndarray) -> str:
    """Describe the first row that differs, compared as bytes: NaN is kept and must count as equal."""
    kind = f"V{wanted.dtype.itemsize}"
    differ = np.ascontiguousarray(found).view(kind) != np.ascontiguousarray(wanted).view(kind)
    row = int(np.flatnonzero(differ)[0])
    return f"{name} of splat {start + row:,} is {found[row]:.9g}, not {wanted[row]:.9g}"
