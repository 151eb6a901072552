"""ASPRS LAS and its compressed twin LAZ, read by laspy: positions, colours, intensity and classes."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.trial import survives_trial
from instdrive_core.formats.allocation import WHOLE, ReadOptions, check_memory, count_row_bytes
from instdrive_core.formats.clouds.points import PASSING, CloudPoints, make_cloud_scene
from instdrive_core.progress import report
from instdrive_core.scene.scene import Scene

_REMEDY = "Copy the file again, or export it again from the program that made it"
_BLOCK_POINTS = 1_000_000
_TRIAL = "instdrive_core.formats.clouds.las_trial"
_SPARE, _SPARE_PER_BYTE = 100 << 20, 8
"""Bytes of memory that a whole file may need, and those for each of its bytes."""
_HEADER_BYTES, _POINTS_START, _LONG_COUNT_START = 375, 96, 247
_DAMAGE = (OSError, ValueError, EOFError, OverflowError, MemoryError, TypeError, struct.error)
"""What laspy raises for damaged files beside its own errors."""
_POINTS, _LONG_COUNT = struct.Struct("<I4xBHI"), struct.Struct("<Q")
"""First byte of the points, their format, bytes of each, and their count."""
_SMALL_COUNT, _POINTS_PER_BYTE = 400_000, 2
"""Points that a compressed file can be believed to hold: real ones take two bytes each or more."""


def read_las(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .las or .laz as a cloud. Its classes are kept in the column `classification`.

    Raises DataError where it is damaged, MissingExtraError where laspy is not installed.
    """
    path = Path(path)
    try:
        import laspy
    except ModuleNotFoundError as error:
        raise explain_missing_module(error) or error from error
    _check_count(path)
    if not survives_trial(_TRIAL, path, _SPARE + _SPARE_PER_BYTE * path.stat().st_size):
        raise DataError(path, "is damaged: it cannot be read in the memory that a whole file needs", _REMEDY)
    try:
        with laspy.open(str(path), laz_backend=laspy.LazBackend.Lazrs) as reader:
            cloud = _read_points(reader, path, options)
    except DataError:
        raise
    except (laspy.LaspyException, *_DAMAGE) as error:
        raise _refuse(path, error) from error
    except BaseException as error:  # lazrs ends by a panic of its own kind where a chunk is damaged
        if type(error).__name__ not in ("PanicException", "LazrsError"):
            raise
        raise _refuse(path, error) from error
    return make_cloud_scene(path, cloud, options)


def _check_count(path: Path) -> None:
    """Check the promised points against the file's size. Raises DataError."""
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(_HEADER_BYTES).ljust(_HEADER_BYTES, b"\0")
    if not header.startswith(b"LASF"):
        raise DataError(path, f"the file begins with {header[:4]!r}, not b'LASF'", "Check that it is a .las or .laz")
    start, kind, width, count = _POINTS.unpack_from(header, _POINTS_START)
    count = count or _LONG_COUNT.unpack_from(header, _LONG_COUNT_START)[0]  # from version 1.4 on
    if start > size:
        raise DataError(path, f"its points begin at byte {start}, the file ends at {size}", _REMEDY)
    is_compressed = kind & 0x80
    most = _SMALL_COUNT + _POINTS_PER_BYTE * size if is_compressed else max(0, size - start) // max(1, width)
    if not 0 < count <= most:
        raise DataError(path, f"the header promises {count} points, {size} bytes hold up to {most}", _REMEDY)


def _refuse(path: Path, error: BaseException) -> DataError:
    return DataError(path, f"is no readable .las or .laz ({str(error)[:200] or type(error).__name__})", _REMEDY)


def _read_points(reader: Any, path: Path, options: ReadOptions) -> CloudPoints:
    header = reader.header
    count = int(header.point_count)
    check_memory(path, count, count_row_bytes(0, 0) + PASSING, options, PASSING * count)
    names = set(header.point_format.dimension_names)
    positions = np.empty((count, 3))
    columns = {
        name: np.empty(count, kind)
        for name, kind in (
            ("intensity", "u2"),
            ("classification", "u1"),
            *((c, "u2") for c in ("red", "green", "blue")),
        )
        if name in names
    }
    start = 0
    for chunk in reader.chunk_iterator(_BLOCK_POINTS):
        rows = slice(start, start + len(chunk))
        if rows.stop > count:
            raise DataError(path, f"more than the promised {count} points follow", _REMEDY)
        for axis, values in enumerate((chunk.x, chunk.y, chunk.z)):
            positions[rows, axis] = values
        for name, column in columns.items():
            column[rows] = chunk[name]
        start = rows.stop
        report(start / count)
    if start < count:
        raise DataError(path, f"the file ends after {start} of {count} points", _REMEDY)
    classes = columns.get("classification")
    return CloudPoints(
        positions,
        _join_colors(columns),
        columns["intensity"].astype(np.float32) if "intensity" in columns else None,
        {} if classes is None or not classes.any() else {"classification": classes},
    )


def _join_colors(columns: dict[str, ndarray]) -> ndarray | None:
    """Join colours as bytes; files hold 16 bits, or 8 in the lower half. None where there are none, or all black."""
    if "red" not in columns:
        return None
    colors = np.stack([columns[name] for name in ("red", "green", "blue")], axis=1)
    highest = int(colors.max())
    if not highest:
        return None
    return (colors if highest < 256 else colors >> 8).astype(np.uint8)
