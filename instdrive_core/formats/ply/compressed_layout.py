"""The header of a .compressed.ply: places of chunks, packed vertices and SH bytes, checked against the file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from instdrive_core.errors import DataError
from instdrive_core.files.ply_header import REMEDY, PlyElement, PlyLayout, read_ply_layout
from instdrive_core.maths.spherical_harmonics import REST_COUNTS

CHUNK = 256
"""Splats that share one row of bounds."""
PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_AXES, _SCALES, _CHANNELS = ("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")
BOUNDS = tuple(f"{end}_{name}" for names in (_AXES, _SCALES, _CHANNELS) for end in ("min", "max") for name in names)
"""Columns of a chunk in the file's order: the least and the most of position, log scale and colour."""
COLOR_BOUNDS = BOUNDS[12:]
"""Absent in files of the first versions, where colours are from 0 to 1."""


@dataclass(frozen=True)
class Table:
    """Rows of one element in the file."""

    offset: int
    count: int
    dtype: np.dtype


@dataclass(frozen=True)
class CompressedLayout:
    """Where the tables of a .compressed.ply lie."""

    chunks: Table
    vertices: Table
    sh: Table | None
    """One row of bytes per splat, or none at SH degree 0."""
    sh_count: int
    """Coefficients above the constant, per channel."""
    comments: tuple[str, ...]


def read_compressed_layout(file: BinaryIO, path: Path, file_size: int) -> CompressedLayout:
    """Parse and check the header. Elements and properties that are not known are passed over. Raises DataError."""
    layout = read_ply_layout(file, path)
    if layout.order == "=":
        raise DataError(path, "a compressed .ply cannot be ASCII", REMEDY)
    tables = _locate_tables(layout, path, file_size)
    for name, wanted in (("chunk", BOUNDS[:12]), ("vertex", PACKED)):
        if name not in tables:
            raise DataError(path, f"the header names no {name} element", "Rename a plain .ply file to end in .ply only")
        missing = [column for column in wanted if column not in (tables[name].dtype.names or ())]
        if missing:
            problem = f"the {name} element has no {', '.join(missing)}"
            raise DataError(path, problem, "Rename a plain .ply file to end in .ply only, or export it again")
    chunks, vertices, sh = tables["chunk"], tables["vertex"], tables.get("sh")
    _check_kinds(chunks, BOUNDS, "f4", "float", path)
    _check_kinds(vertices, PACKED, "u4", "uint", path)
    if chunks.count != -(-vertices.count // CHUNK):
        problem = f"{chunks.count} chunks do not fit {vertices.count} splats, {CHUNK} to a chunk"
        raise DataError(path, problem, REMEDY)
    sh_count = _count_sh(sh, vertices.count, path)
    return CompressedLayout(chunks, vertices, sh if sh_count else None, sh_count, layout.comments)


def _locate_tables(layout: PlyLayout, path: Path, file_size: int) -> dict[str, Table]:
    """Locate every element before the first one with lists, whose rows cannot be counted in bytes."""
    tables: dict[str, Table] = {}
    offset = layout.body_offset
    fixed = True
    for element in layout.elements:
        fixed = fixed and not element.has_list
        if element.name in tables or (not fixed and element.name in ("chunk", "vertex", "sh")):
            problem = f"the element {element.name!r} stands twice in the header, or after or among list properties"
            raise DataError(path, problem, REMEDY)
        if fixed:
            tables[element.name] = _build_table(element, layout.order, offset)
            offset += tables[element.name].count * tables[element.name].dtype.itemsize
    _check_length(offset, fixed, path, file_size)
    return tables


def _build_table(element: PlyElement, order: str, offset: int) -> Table:
    return Table(offset, element.count, element.build_dtype(order))


def _check_length(end: int, is_all: bool, path: Path, file_size: int) -> None:
    """Refuse a lying count before anything is allocated by it."""
    if file_size < end:
        problem = f"the header promises {end} bytes, {file_size} are there"
        raise DataError(path, problem, "The file was cut off or its header is wrong; copy or export it again")
    if is_all and file_size > end:
        problem = f"{file_size - end} bytes follow the {end} that the header promises"
        raise DataError(path, problem, "The header's counts are wrong; export the file again")


def _check_kinds(table: Table, names: tuple[str, ...], kind: str, word: str, path: Path) -> None:
    for name in names:
        if name in (table.dtype.names or ()) and table.dtype[name].str[1:] != kind:
            raise DataError(path, f"the property {name!r} is of the wrong type, not {word}", REMEDY)


def _count_sh(sh: Table | None, splats: int, path: Path) -> int:
    if sh is None:
        return 0
    names = sh.dtype.names or ()
    numbers = {int(match[1]) for name in names if (match := re.fullmatch(r"f_rest_(\d{1,6})", name))}
    if numbers != set(range(len(numbers))) or len(numbers) % 3 or len(numbers) // 3 not in REST_COUNTS:
        counts = ", ".join(str(3 * count) for count in REST_COUNTS)
        problem = f"{len(numbers)} f_rest columns in the sh element fit no SH degree"
        raise DataError(path, problem, f"There must be one of {counts}, numbered from 0 without a gap")
    if sh.count != splats:
        raise DataError(path, f"the sh element has {sh.count} rows, there are {splats} splats", REMEDY)
    _check_kinds(sh, tuple(f"f_rest_{number}" for number in numbers), "u1", "uchar", path)
    return len(numbers) // 3
