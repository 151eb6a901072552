"""Scenes as .ply files in INRIA's layout (Kerbl et al. 2023), with instances and features as extra columns.

Reading goes by property name, in any order, type and byte order; columns that are not known are kept. Writing follows
INRIA's column order: x y z, normals, f_dc, f_rest (channel-major), opacity, scale, rot (w first), then the extra ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.files.ply_header import REMEDY, PlyHeader, read_ply_header
from instdrive_core.formats.allocation import WHOLE, ReadOptions, allocate_gaussians
from instdrive_core.formats.export_checks import check_static
from instdrive_core.formats.ply.columns import (
    ID_LIMITS,
    NORMALS,
    TYPE_NAMES,
    check_columns,
    check_whole_numbers,
    view_columns,
    view_features,
)
from instdrive_core.formats.ply.comments import build_comments, parse_comments
from instdrive_core.formats.ply.compressed import read_compressed_ply
from instdrive_core.formats.ply.compressed_layout import PACKED
from instdrive_core.instances.table import build_instance_table
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians, create_empty_gaussians
from instdrive_core.scene.scene import Scene

CHUNK_ROWS = 1024
"""Rows converted at a time: about 250 kB, so that a chunk and where its columns go lie in a core's own cache."""
LONGEST_VALUE = 256
"""Bytes of a number in text, with what separates it from the next."""
PIECE = 1 << 16


def read_ply(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .ply of 3D Gaussians: ASCII, binary or packed. Raises DataError where anything about it is wrong."""
    path = Path(path)
    with path.open("rb") as file:
        header = read_ply_header(file, path, path.stat().st_size)
        names = header.dtype.names or ()
        if set(PACKED) <= set(names):
            return read_compressed_ply(path, options)
        rest, features = check_columns(names, path)
        extra_bytes = sum(header.dtype[name].itemsize for name in _find_unknown_columns(names, rest, features))
        gaussians = allocate_gaussians(path, header.count, rest, features, options, extra=extra_bytes)
        count = len(gaussians)
        ids = {name: np.zeros(count, np.uint32) for name in ID_LIMITS}
        known = view_columns(gaussians) | view_features(gaussians) | ids
        extra = {name: np.empty(count, header.dtype[name].newbyteorder("=")) for name in names if name not in known}
        targets = known | extra
        start = 0
        for chunk in read_chunks(file, header, path):
            source, target = options.locate_rows(start, start + len(chunk))
            for name in names:
                if name in ids:
                    check_whole_numbers(chunk[name], name, path)
                targets[name][target] = chunk[name][source]
            start += len(chunk)
            report(start / header.count)
    return _assemble_scene(gaussians, ids, extra, header, path)


def write_ply(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment, atomically. Sky and camera views have no place in a .ply.

    Raises DataError where the scene has moving actors: place them first (`edits.bake.frozen_at`).
    """
    check_static(path, scene, ".ply")
    columns = collect_columns(scene)
    dtype = np.dtype([(name, column.dtype.newbyteorder("<")) for name, column in columns.items()])
    with open_atomically(path) as file:
        file.write(_build_header(scene, dtype))
        for start in range(0, len(scene), CHUNK_ROWS):
            chunk = np.empty(min(CHUNK_ROWS, len(scene) - start), dtype)
            for name, column in columns.items():
                chunk[name] = column[start : start + CHUNK_ROWS]
            file.write(chunk.data)
            report(start / len(scene))


def collect_columns(scene: Scene) -> dict[str, ndarray]:
    """The columns (n,) of a scene's file, in their order there."""
    inria = view_columns(scene.gaussians)
    zeros = np.broadcast_to(np.float32(0), len(scene))
    normals = {name: scene.extra.get(name, zeros) for name in NORMALS}
    columns = {name: inria.pop(name) for name in "xyz"} | normals | inria
    if len(scene.table) or scene.code_bits:
        columns |= {"instance_id": scene.instance_ids, "codeword": scene.codewords}
    return columns | view_features(scene.gaussians) | scene.extra


def _build_header(scene: Scene, dtype: np.dtype) -> bytes:
    assert dtype.fields is not None
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"comment {comment}" for comment in build_comments(scene)]
    lines.append(f"element vertex {len(scene)}")
    lines += [f"property {TYPE_NAMES[kind.str[1:]]} {name}" for name, (kind, *_) in dtype.fields.items()]
    return "\n".join([*lines, "end_header", ""]).encode()


def _find_unknown_columns(names: tuple[str, ...], rest: int, features: int) -> set[str]:
    """Columns that are kept as they are."""
    one = create_empty_gaussians(rest, features)
    return set(names) - view_columns(one).keys() - view_features(one).keys() - ID_LIMITS.keys()


def read_chunks(file: BinaryIO, header: PlyHeader, path: Path) -> Iterator[ndarray]:
    """The vertices as structured arrays of up to `CHUNK_ROWS` rows. Raises DataError where the file ends too early."""
    if header.is_ascii:
        yield from _read_ascii_chunks(file, header, path)
        return
    file.seek(header.body_offset)
    for start in range(0, header.count, CHUNK_ROWS):
        wanted = min(CHUNK_ROWS, header.count - start)
        chunk = np.fromfile(file, header.dtype, wanted)
        if len(chunk) < wanted:
            raise DataError(path, f"the file ends after {start + len(chunk)} of {header.count} splats", REMEDY)
        yield chunk


def _read_ascii_chunks(file: BinaryIO, header: PlyHeader, path: Path) -> Iterator[ndarray]:
    _skip_lines(file, header.skipped_lines)
    lines = _read_lines(file, LONGEST_VALUE * len(header.dtype.names or ()) + LONGEST_VALUE, path)
    for start in range(0, header.count, CHUNK_ROWS):
        part = list(islice(lines, min(CHUNK_ROWS, header.count - start)))
        if start + len(part) < min(start + CHUNK_ROWS, header.count):
            raise DataError(path, f"the file ends after {start + len(part)} of {header.count} splats", REMEDY)
        try:
            values = np.loadtxt(part, np.float64, comments=None, ndmin=2)
        except ValueError as error:
            raise DataError(path, f"splats {start} to {start + len(part)} are not numbers ({error})", REMEDY) from error
        names = header.dtype.names or ()
        if values.shape[1] != len(names):
            problem = f"a line holds {values.shape[1]} values, the header promises {len(names)}"
            raise DataError(path, problem, REMEDY)
        chunk = np.empty(len(part), header.dtype)
        for name, column in zip(names, values.T, strict=True):
            if header.dtype[name].kind in "iu":
                _check_integers(column, name, header.dtype[name], path)
            with np.errstate(over="ignore"):  # too large for float32 is infinite, which the linter reports
                chunk[name] = column
        yield chunk
    if header.is_last and next(lines, None) is not None:
        problem = f"more lines follow the {header.count} splats that the header promises"
        raise DataError(path, problem, "The header's count is wrong; export the file again")


def _skip_lines(file: BinaryIO, count: int) -> None:
    """Pass over lines of any length, blank ones not counted, as far as there are any."""
    while count and (piece := file.readline(PIECE)):
        is_blank = not piece.strip()
        while piece and not piece.endswith(b"\n"):
            piece = file.readline(PIECE)
            is_blank = is_blank and not piece.strip()
        count -= not is_blank


def _read_lines(file: BinaryIO, longest: int, path: Path) -> Iterator[bytes]:
    """Lines that are not blank. Raises DataError for one too long for its values, before memory is taken for it."""
    while line := file.readline(longest):
        if len(line) == longest and not line.endswith(b"\n"):
            problem = f"a line is longer than {longest:,} bytes, too many for the values that the header promises"
            raise DataError(path, problem, REMEDY)
        if line.strip():
            yield line


def _check_integers(values: ndarray, name: str, dtype: np.dtype, path: Path) -> None:
    """Text may promise whole numbers and hold others, which casting would make any number of."""
    limits = np.iinfo(dtype)
    wrong = np.flatnonzero(~((values >= limits.min) & (values <= limits.max) & (values == np.floor(values))))
    if len(wrong):
        problem = f"column {name!r} holds {values[wrong[0]]:g}, not a whole number of the type in the header"
        raise DataError(path, problem, REMEDY)


def _assemble_scene(
    gaussians: Gaussians, ids: dict[str, ndarray], extra: dict[str, ndarray], header: PlyHeader, path: Path
) -> Scene:
    # INRIA writes zero normals that nobody reads; only real ones are worth their memory.
    if not any(extra[name].any() for name in NORMALS if name in extra):
        extra = {name: column for name, column in extra.items() if name not in NORMALS}
    notes = parse_comments(header.comments, path)
    instance_ids, codewords = ids["instance_id"], ids["codeword"]
    table = build_instance_table(instance_ids, gaussians.means, codewords, None, notes.names, notes.classes)
    return Scene(
        gaussians=gaussians,
        instance_ids=instance_ids,
        codewords=codewords,
        nodes=np.zeros(len(gaussians), np.uint16),
        table=table,
        origin=notes.origin,
        code_bits=notes.code_bits,
        antialiased=notes.antialiased,
        extra=extra,
    )
