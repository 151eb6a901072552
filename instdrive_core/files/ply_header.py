"""The header of a .ply file: format, elements, properties, comments, checked against the file's length."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from instdrive_core.errors import DataError

MAX_HEADER_BYTES = 16 << 20
MAX_COLUMNS = 4096
MAX_ELEMENTS = 256
_MAX_DIGITS = 4000
"""Python refuses to read more than some; far fewer are too many for any file."""
REMEDY = "Export the file again from the program that made it"
_FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    name: kind
    for kind, names in {
        "i1": ("char", "int8"),
        "u1": ("uchar", "uint8"),
        "i2": ("short", "int16"),
        "u2": ("ushort", "uint16"),
        "i4": ("int", "int32"),
        "u4": ("uint", "uint32"),
        "f4": ("float", "float32"),
        "f8": ("double", "float64"),
    }.items()
    for name in names
}


@dataclass(frozen=True)
class PlyHeader:
    """The vertices that a file promises, and where they begin."""

    is_ascii: bool
    noun: str
    """Name of the vertices in messages: ``splats`` or ``points``."""
    count: int
    """Rows of the vertex element."""
    dtype: np.dtype
    """One vertex, in the file's byte order (native for ASCII)."""
    body_offset: int
    """Bytes before the first vertex."""
    skipped_lines: int
    """Rows of elements before the vertices (ASCII)."""
    skipped_least: int
    """Bytes that they take at least."""
    is_last: bool
    """Whether nothing follows the vertices."""
    comments: tuple[str, ...]


@dataclass
class PlyElement:
    """One element of a header: its rows follow those of the element before."""

    name: str
    count: int
    kinds: dict[str, str] = field(default_factory=dict)
    """NumPy's kind (``f4``) of each column, in their order."""
    has_list: bool = False
    """Rows of an element with lists differ in length."""

    def build_dtype(self, order: str) -> np.dtype:
        """Describe one row, without lists, in a byte order (``<``, ``>`` or ``=``)."""
        return np.dtype([(name, order + kind) for name, kind in self.kinds.items()])

    def add(self, name: str, kind: str, path: Path) -> None:
        """Add a column. Raises DataError where it has that one, or more than any program writes."""
        if name in self.kinds:
            raise DataError(path, f"property {name!r} stands twice in the header", REMEDY)
        if len(self.kinds) == MAX_COLUMNS:
            problem = f"the element {self.name!r} has more than {MAX_COLUMNS:,} properties"
            raise DataError(path, problem, "Leave out those that no reader needs")
        self.kinds[name] = kind

    def count_least_text(self) -> int:
        """Count the bytes that all rows need in ASCII: a digit and a separator for each value; a list's length."""
        return self.count * 2 * max(len(self.kinds) + self.has_list, 1)


@dataclass(frozen=True)
class PlyLayout:
    """A header as it stands, not yet checked against the file's length."""

    order: str
    """``<`` or ``>``; ``=`` for ASCII."""
    elements: tuple[PlyElement, ...]
    comments: tuple[str, ...]
    body_offset: int
    """Bytes of the header."""


def read_ply_layout(file: BinaryIO, path: Path) -> PlyLayout:
    """Parse the header of any .ply. Raises DataError where it is none, or a line is not understood."""
    lines, end = _read_header_lines(file, path)
    order, elements, comments = _parse_lines(lines, path)
    return PlyLayout(order, tuple(elements), tuple(comments), end)


def read_ply_header(file: BinaryIO, path: Path, file_size: int, noun: str = "splats") -> PlyHeader:
    """Parse the header and check its counts against the file's size in bytes. Raises DataError.

    `noun` is what messages call the vertices.
    """
    return find_ply_vertices(read_ply_layout(file, path), path, file_size, noun)


def find_ply_vertices(layout: PlyLayout, path: Path, file_size: int, noun: str = "splats") -> PlyHeader:
    """Find the vertices in a header and check its counts; arguments and errors as in `read_ply_header`."""
    names = [element.name for element in layout.elements]
    if "vertex" not in names:
        raise DataError(path, f"the header names no vertex element, only {names}", REMEDY)
    return _describe_element(layout, names.index("vertex"), path, file_size, noun)


def describe_all_elements(layout: PlyLayout, path: Path, file_size: int) -> dict[str, PlyHeader]:
    """Describe every element as one whose rows are splats, by its name, each checked against the file's size in bytes.

    Of an ASCII file each begins where the one before ends. Raises DataError.
    """
    found: dict[str, PlyHeader] = {}
    for row, element in enumerate(layout.elements):
        if element.name in found:
            raise DataError(path, f"the element {element.name!r} stands twice in the header", REMEDY)
        found[element.name] = _describe_element(layout, row, path, file_size, "splats")
    return found


def _describe_element(layout: PlyLayout, row: int, path: Path, file_size: int, noun: str) -> PlyHeader:
    order, elements, end = layout.order, layout.elements, layout.body_offset
    before, element = elements[:row], elements[row]
    is_ascii = order == "="
    if element.has_list:
        raise DataError(path, "a list property stands among the vertices, which must be numbers", REMEDY)
    if not is_ascii and any(other.has_list for other in before):
        problem = "rows of lists stand before the vertices, so that nothing says where these begin"
        raise DataError(path, problem, "Export it without faces, as ASCII, or with the vertices first")
    dtype = element.build_dtype(order)
    offset = end if is_ascii else end + sum(other.build_dtype(order).itemsize * other.count for other in before)
    header = PlyHeader(
        is_ascii=is_ascii,
        noun=noun,
        count=element.count,
        dtype=dtype,
        body_offset=offset,
        skipped_lines=sum(other.count for other in before),
        skipped_least=sum(other.count_least_text() for other in before),
        is_last=row == len(elements) - 1,
        comments=layout.comments,
    )
    _check_length(header, path, file_size)
    return header


def _read_header_lines(file: BinaryIO, path: Path) -> tuple[list[str], int]:
    if file.read(3) != b"ply":
        raise DataError(path, "the file does not begin with 'ply'", "Check that it is a .ply file")
    file.seek(0)
    lines, size = [], 0
    while size < MAX_HEADER_BYTES:
        line = file.readline(MAX_HEADER_BYTES)
        size += len(line)
        if not line.endswith(b"\n"):
            break
        lines.append(line.decode("utf-8", errors="replace").strip())
        if lines[-1] == "end_header":
            return lines[1:-1], size
    raise DataError(path, "the header has no 'end_header' line", REMEDY)


def _parse_lines(lines: list[str], path: Path) -> tuple[str, list[PlyElement], list[str]]:
    order, elements, comments = "", [], []
    for line in lines:
        words = line.split()
        match words:
            case ["format", name, "1.0"] if name in _FORMATS:
                order = _FORMATS[name]
            case ["comment" | "obj_info", *_]:
                comments.append(" ".join(line.split(maxsplit=1)[1:]))
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) <= _MAX_DIGITS:
                if len(elements) == MAX_ELEMENTS:
                    raise DataError(path, f"the header has more than {MAX_ELEMENTS:,} elements", REMEDY)
                elements.append(PlyElement(name, int(count)))
            case ["property", "list", _, _, _] if elements:
                elements[-1].has_list = True
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].add(name, _TYPES[kind], path)
            case []:
                continue
            case _:
                raise DataError(path, f"the header line {line[:80]!r} is not understood", REMEDY)
    if not order:
        raise DataError(path, "the header names no format (ascii, binary_little_endian, binary_big_endian)", REMEDY)
    return order, elements, comments


def _check_length(header: PlyHeader, path: Path, file_size: int) -> None:
    """Refuse a lying count before anything is allocated by it."""
    available = file_size - header.body_offset
    if header.is_ascii:
        needed = header.skipped_least + header.count * 2 * max(len(header.dtype.names or ()), 1) - 1
        exact = False
    else:
        needed = header.count * header.dtype.itemsize
        exact = header.is_last
    if available < needed:
        problem = (
            f"the header promises {header.count} {header.noun}, at least {needed} bytes; {max(available, 0)} are there"
        )
        raise DataError(path, problem, "The file was cut off or its header is wrong; copy or export it again")
    if exact and available > needed:
        problem = f"{available - needed} bytes follow the {header.count} {header.noun} that the header promises"
        raise DataError(path, problem, "The header's count is wrong; export the file again")
