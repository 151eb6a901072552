"""ASPRS LAS and its compressed twin LAZ, read by laspy: positions, colours, intensity and classes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.extras import explain_missing_module
from instdrive_core.formats.allocation import WHOLE, ReadOptions, check_memory, count_row_bytes
from instdrive_core.formats.clouds.points import PASSING, CloudPoints, make_cloud_scene
from instdrive_core.progress import report
from instdrive_core.scene.scene import Scene

_REMEDY = "Copy the file again, or export it again from the program that made it"
_BLOCK_POINTS = 1_000_000
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
    try:
        with laspy.open(str(path)) as reader:
            cloud = _read_points(reader, path, options)
    except DataError:
        raise
    except (laspy.LaspyException, OSError, ValueError, EOFError, OverflowError, MemoryError, TypeError) as error:
        raise _refuse(path, error) from error
    except BaseException as error:  # lazrs ends by a panic of its own kind where a chunk is damaged
        if type(error).__name__ not in ("PanicException", "LazrsError"):
            raise
        raise _refuse(path, error) from error
    return make_cloud_scene(path, cloud, options)


def _refuse(path: Path, error: BaseException) -> DataError:
    return DataError(path, f"is no readable .las or .laz ({str(error)[:200] or type(error).__name__})", _REMEDY)


def _read_points(reader: Any, path: Path, options: ReadOptions) -> CloudPoints:
    header, size = reader.header, path.stat().st_size
    count = int(header.point_count)
    if header.are_points_compressed:
        most = _SMALL_COUNT + _POINTS_PER_BYTE * size
    else:
        most = max(0, size - int(header.offset_to_point_data)) // max(1, int(header.point_format.size))
    if not 0 < count <= most:
        raise DataError(path, f"the header promises {count} points, {size} bytes hold up to {most}", _REMEDY)
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
