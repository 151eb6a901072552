"""Point clouds of PCL (.pcd, versions 0.6 and 0.7): text, binary, or compressed by LZF."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import WHOLE, ReadOptions, check_memory, count_row_bytes
from instdrive_core.formats.clouds.lzf import HIGHEST_RATIO, decompress_lzf
from instdrive_core.formats.clouds.points import PASSING, CloudPoints, make_cloud_scene
from instdrive_core.scene.scene import Scene

_REMEDY = "Copy the file again, or export it again from the program that made it"
_MAX_HEADER_BYTES, _MAX_FIELDS, _MAX_VALUES = 1 << 16, 256, 1024
_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_SHORTEST_TEXT = 2
"""Bytes of a number in text and what separates it from the next."""


@dataclass(frozen=True)
class PcdHeader:
    """What the header says."""

    record: np.dtype
    count: int
    data: str
    """``ascii``, ``binary`` or ``binary_compressed``."""
    start: int
    """Bytes before the points."""


def read_pcd(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .pcd as a cloud. Raises DataError where anything about it is wrong."""
    path = Path(path)
    header = _read_header(path)
    check_memory(path, header.count, count_row_bytes(0, 0) + PASSING, options, PASSING * header.count)
    rows = _READERS[header.data](path, header)
    names = rows.dtype.names or ()
    with np.errstate(invalid="ignore"):  # what signals that it is no number is found below
        positions = np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)
    packed = next((name for name in ("rgb", "rgba") if name in names), None)
    intensities = next((rows[name].astype(np.float64) for name in ("intensity", "i") if name in names), None)
    colors = None if packed is None or rows.dtype[packed].itemsize != 4 else _unpack_colors(rows[packed])
    return make_cloud_scene(path, CloudPoints(positions, colors, intensities), options)


def _read_header(path: Path) -> PcdHeader:
    with path.open("rb") as file:
        beginning = file.read(_MAX_HEADER_BYTES)
    said, start = dict[str, list[str]](), 0
    while "DATA" not in said:
        end = beginning.find(b"\n", start)
        if end < 0:
            raise DataError(path, "its header has no line DATA", "Check that it is a .pcd file")
        words = beginning[start:end].decode("ascii", "replace").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            said[words[0].upper()] = words[1:]
    record = _describe_record(path, said)
    numbers = [_parse_count(path, said, name) for name in ("WIDTH", "HEIGHT", "POINTS") if name in said]
    count = numbers[-1] if "POINTS" in said else int(np.prod(numbers)) if len(numbers) == 2 else 0
    if not count or ("POINTS" in said and len(numbers) == 3 and numbers[0] * numbers[1] != count):
        raise DataError(path, f"WIDTH, HEIGHT and POINTS are {numbers}, which do not fit", _REMEDY)
    data = " ".join(said["DATA"]).lower()
    if data not in _READERS:
        raise DataError(path, f"DATA is {data[:40]!r}, none of {', '.join(_READERS)}", _REMEDY)
    return PcdHeader(record, count, data, start)


def _describe_record(path: Path, said: dict[str, list[str]]) -> np.dtype:
    names, kinds, sizes = (said.get(key, []) for key in ("FIELDS", "TYPE", "SIZE"))
    counts = said.get("COUNT", ["1"] * len(names))
    if not names or not len(names) == len(kinds) == len(sizes) == len(counts) or len(names) > _MAX_FIELDS:
        raise DataError(path, "FIELDS, TYPE, SIZE and COUNT do not have one entry for each field", _REMEDY)
    fields = []
    for place, (name, kind, size, count) in enumerate(zip(names, kinds, sizes, counts, strict=True)):
        good = size.isdecimal() and count.isdecimal() and max(len(size), len(count)) < 5 and kind in _KINDS
        if not good or int(size) not in _SIZES[kind] or not 0 < int(count) <= _MAX_VALUES:
            problem = f"the field {name[:40]!r} has {count[:20]} values of {size[:20]} {kind[:20]}"
            raise DataError(path, problem, _REMEDY)
        shape = () if int(count) == 1 else (int(count),)
        taken = name == "_" or name in (field[0] for field in fields)
        fields.append((f"_{place}" if taken else name, f"<{_KINDS[kind]}{size}", shape))
    record = np.dtype(fields)
    missing = [axis for axis in "xyz" if axis not in (record.names or ()) or record[axis].shape]
    if missing:
        raise DataError(path, f"the points have no {', '.join(missing)}", _REMEDY)
    return record


def _parse_count(path: Path, said: dict[str, list[str]], name: str) -> int:
    words = said[name]
    if len(words) != 1 or not words[0].isdecimal() or len(words[0]) > 12:
        raise DataError(path, f"{name} is {' '.join(words)[:40]!r}, not a whole number", _REMEDY)
    return int(words[0])


def _read_binary(path: Path, header: PcdHeader) -> ndarray:
    _require_bytes(path, header.start, header.count * header.record.itemsize)
    return np.fromfile(path, header.record, header.count, offset=header.start)


def _read_text(path: Path, header: PcdHeader) -> ndarray:
    names = header.record.names or ()
    widths = [int(np.prod(header.record[name].shape)) for name in names]
    _require_bytes(path, header.start, header.count * sum(widths) * _SHORTEST_TEXT - 1)
    with path.open("rb") as file:
        file.seek(header.start)
        words = file.read().split()
    if len(words) != header.count * sum(widths):
        problem = f"{len(words)} numbers follow, {header.count} points have {header.count * sum(widths)}"
        raise DataError(path, problem, _REMEDY)
    try:
        values = np.array(words, "S").astype(np.float64).reshape(header.count, sum(widths))
    except ValueError as error:
        raise DataError(path, f"a value is no number ({str(error)[:80]})", _REMEDY) from error
    rows = np.zeros(header.count, header.record)
    ends = np.cumsum(widths)
    with np.errstate(invalid="ignore", over="ignore"):
        for name, width, end in zip(names, widths, ends, strict=True):
            part = values[:, end - width : end].astype(header.record[name].base)
            rows[name] = part.reshape(rows[name].shape)
    return rows


def _read_compressed(path: Path, header: PcdHeader) -> ndarray:
    """Read a block by LZF, in which all values of a field lie behind each other."""
    _require_bytes(path, header.start, 8)
    with path.open("rb") as file:
        file.seek(header.start)
        packed_size, size = struct.unpack("<II", file.read(8))
        expected = header.count * header.record.itemsize
        if size != expected or size > HIGHEST_RATIO * packed_size:
            problem = f"{packed_size} compressed bytes promise {size}, its points have {expected}"
            raise DataError(path, problem, _REMEDY)
        _require_bytes(path, header.start + 8, packed_size)
        out, written = decompress_lzf(np.frombuffer(file.read(packed_size), np.uint8), size)
    if written != size:
        raise DataError(path, "its compressed points are damaged", _REMEDY)
    rows, start = np.zeros(header.count, header.record), 0
    for name in header.record.names or ():
        kind = header.record[name]
        end = start + header.count * kind.itemsize
        rows[name] = out[start:end].view(kind.base).reshape(rows[name].shape)
        start = end
    return rows


def _require_bytes(path: Path, start: int, needed: int) -> None:
    size = path.stat().st_size
    if size - start < needed:
        raise DataError(path, f"its points need {needed} bytes, {max(0, size - start)} follow its header", _REMEDY)


def _unpack_colors(words: ndarray) -> ndarray:
    """Unpack colours that are stored as the bytes 0RGB of a number, whatever its type."""
    values = words.astype(words.dtype.newbyteorder("<")).view("<u4")
    return np.stack([values >> 16 & 255, values >> 8 & 255, values & 255], axis=1).astype(np.uint8)


_READERS = {"ascii": _read_text, "binary": _read_binary, "binary_compressed": _read_compressed}
