"""A sparse sketch of a large .ply: short runs of rows from all over it, while the whole is still to be read."""

from __future__ import annotations

import os
import time
from io import FileIO
from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.files.ply_header import PlyHeader, find_ply_vertices, read_ply_layout
from instdrive_core.formats.allocation import (
    MEMORY_TO_EDIT,
    ReadOptions,
    check_memory,
    count_row_bytes,
    enlarge_splats,
)
from instdrive_core.formats.clouds.ply import is_point_cloud
from instdrive_core.formats.ply.columns import ID_LIMITS, check_columns, check_whole_numbers, view_columns
from instdrive_core.formats.ply.compressed_layout import PACKED
from instdrive_core.formats.ply.inria import assemble_ply_scene
from instdrive_core.formats.ply.street_elements import is_street_ply
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

RUN = 4
"""Rows read together. Longer runs take fewer accesses, but in files that are in spatial order they are clumps."""
PASSES = 16
"""Parts in which the runs are read, each from all over the file: a slow disk gives a sparser sketch of the whole."""
SECONDS = 1.0
"""Time after which no further pass begins."""


def sketch_ply(path: Path, most: int) -> Scene | None:
    """Read about `most` splats, evenly from all over a binary .ply, made larger so that they cover what all do.

    None where the file is ASCII, packed, of actors or points, or has fewer than twice as many. Raises DataError.
    """
    with path.open("rb") as file:
        layout = read_ply_layout(file, path)
        if is_street_ply(layout):
            return None
        header = find_ply_vertices(layout, path, path.stat().st_size)
        names = header.dtype.names or ()
        if header.is_ascii or header.count < 2 * most or set(PACKED) <= set(names) or is_point_cloud(header):
            return None
    rest, features = check_columns(names, path)
    whole = ReadOptions(memory_factor=MEMORY_TO_EDIT)  # of a scene too large to be opened, nothing is shown
    check_memory(path, header.count, count_row_bytes(rest, features), whole)
    with path.open("rb", buffering=0) as file:
        rows = _read_runs(file, header, most)
    shapes = [(3,), (4,), (3,), (), (3,), (rest, 3), (0,)]
    gaussians = Gaussians(*(np.empty((len(rows), *shape), np.float32) for shape in shapes))
    ids = {name: np.zeros(len(rows), np.uint32) for name in ID_LIMITS}
    for name, target in (view_columns(gaussians) | ids).items():
        if name in ids and name not in names:
            continue
        if name in ids:
            check_whole_numbers(rows[name], name, path)
        target[:] = rows[name]
    enlarge_splats(gaussians.log_scales, max(1, round(header.count / max(len(rows), 1))))
    return assemble_ply_scene(gaussians, ids, {}, header, path)


def _read_runs(file: FileIO, header: PlyHeader, most: int) -> ndarray:
    """Read runs of rows, pass by pass, until all are there or the time is over; what the file lacks is left out."""
    starts = np.linspace(0, header.count - RUN, max(most // RUN, 1)).astype(np.int64)
    size, begun, found = header.dtype.itemsize, time.monotonic(), []
    places = header.body_offset + starts * size
    for first in _order_passes():
        found += [_read_at(file, place, RUN * size) for place in places[first::PASSES].tolist()]
        if time.monotonic() - begun > SECONDS:
            break
    return np.frombuffer(b"".join(run for run in found if len(run) == RUN * size), header.dtype)


def _read_at(file: FileIO, place: int, size: int) -> bytes:
    if hasattr(os, "pread"):
        return os.pread(file.fileno(), size, place)
    file.seek(place)
    return file.read(size)


def _order_passes() -> list[int]:
    """0, 8, 4, 12 …: after any number of passes what was read lies evenly."""
    bits = PASSES.bit_length() - 1
    return [int(f"{number:0{bits}b}"[::-1], 2) for number in range(PASSES)]
