"""The meta file of an .lcc scene and its index: which rows of `data.bin` are the finest level of each place.

The layout is that of XGRIDS' LCC white paper. The index has one record for each square of the ground: its number in x
and y (2 int16), then for each level its count (int32), first byte (int64) and bytes (int32).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_numbers
from instdrive_core.files.plain_file import require_plain_file

REMEDY = "Copy the scene again with all its files, or export it again"
INDEX, DATA, HARMONICS, ENVIRONMENT = "index.bin", "data.bin", "shcoef.bin", "environment.bin"
RECORD = np.dtype(
    [("position", "<f4", 3), ("color", "u1", 4), ("scale", "<u2", 3), ("rotation", "<u4"), ("normal", "<u2", 3)]
)
HARMONICS_RECORD = np.dtype([("words", "<u4", 15), ("spare", "<u4")])
ENVIRONMENT_RECORD = np.dtype([("splat", RECORD), ("words", "<u4", 15), ("spare", "<u4")])
"""An environment of a scene with SH."""
_MAX_LEVELS = 64
_MAX_META_BYTES = 16 << 20
_FARTHEST, _LARGEST = 1 << 50, 1e9

Range = Float64[ndarray, "2 3"]
"""What the smallest and the largest stored number of each axis or colour stand for."""


@dataclass(frozen=True)
class LccMeta:
    """What the meta file says, and the finest level's rows."""

    has_harmonics: bool
    ranges: Mapping[str, Range]
    """By attribute: `scale`, `shcoef`, `envscale`, `envshcoef`."""
    counts: Int64[ndarray, " squares"]
    """Splats of the finest level."""
    starts: Int64[ndarray, " squares"]
    """First byte of them in `data.bin`."""
    end: int
    """Byte at which the splats of all levels end in `data.bin`."""

    def get_range(self, name: str) -> Range:
        """Look up an attribute's range; the environment's own, or else that of all."""
        return self.ranges[name] if name in self.ranges else self.ranges[name.removeprefix("env")]


def read_lcc_meta(path: Path) -> LccMeta:
    """Read the meta file and the index beside it. Raises DataError."""
    if path.stat().st_size > _MAX_META_BYTES:
        raise DataError(path, f"it holds more than {_MAX_META_BYTES >> 20} MB", "Check that it is an .lcc file")
    content = read_json(path)
    levels = require_field(path, content, "totalLevel")
    if isinstance(levels, bool) or not isinstance(levels, int) or not 0 < levels <= _MAX_LEVELS:
        raise DataError(path, f"the field 'totalLevel' is {levels!r}, not from 1 to {_MAX_LEVELS}", REMEDY)
    ranges = _parse_ranges(path, require_field(path, content, "attributes"))
    kind = content.get("fileType")
    has_harmonics = "shcoef" in ranges if kind not in ("Portable", "Quality") else kind == "Quality"
    for needed in ("scale", *(["shcoef"] if has_harmonics else [])):
        if needed not in ranges:
            raise DataError(path, f"no attribute is called {needed!r}", REMEDY)
    counts, starts, end = _read_index(path.parent / INDEX, levels)
    promised = require_field(path, content, "splats")
    promised = promised[0] if isinstance(promised, list) and promised else promised
    if promised != int(counts.sum()):
        problem = f"'splats' promises {promised!r} of the finest level, {INDEX} has {int(counts.sum())}"
        raise DataError(path, problem, REMEDY)
    return LccMeta(has_harmonics, ranges, counts, starts, end)


def require_file(path: Path, name: str, needed: int) -> Path:
    """Return the file `name` beside a meta file. Raises DataError where it is missing or has not `needed` bytes."""
    file = path.parent / name
    if not file.is_file():
        raise DataError(path, f"{name} beside it is missing", REMEDY)
    size = require_plain_file(file).stat().st_size
    if size < needed:
        raise DataError(path, f"{name} beside it has {size} bytes, its splats need {needed}", REMEDY)
    return file


def is_lcc_scene(path: Path) -> bool:
    """Whether this is an .lcc file with its index beside it, or a folder with one."""
    return _find_meta(path) is not None


def get_meta_path(path: Path) -> Path:
    """Look up the meta file of a folder; a file is one itself. Raises DataError where there is none, or two."""
    found = _find_meta(path)
    if found is None:
        raise DataError(path, f"there is no .lcc file with {INDEX} beside it", REMEDY)
    return found


def list_lcc_files(path: Path) -> tuple[Path, ...]:
    """List the files that are read. Raises DataError where there is no scene."""
    meta = get_meta_path(path)
    files = (meta, *(meta.parent / name for name in (INDEX, DATA, HARMONICS, ENVIRONMENT)))
    return tuple(sorted(file for file in files if file.is_file()))


def _find_meta(path: Path) -> Path | None:
    if path.is_file():
        return path if path.suffix.lower() == ".lcc" else None
    if not path.is_dir() or not (path / INDEX).is_file():
        return None
    found = [Path(entry.path) for entry in os.scandir(path) if entry.name.lower().endswith(".lcc")]
    return found[0] if len(found) == 1 else None


def _parse_ranges(path: Path, attributes: Any) -> dict[str, Range]:
    if not isinstance(attributes, list):
        raise DataError(path, f"the field 'attributes' is a {type(attributes).__name__}, not a list", REMEDY)
    ranges = {}
    for entry in attributes:
        name = require_field(path, entry, "name", "attributes[].")
        if name not in ("scale", "shcoef", "envscale", "envshcoef"):
            continue
        ends = [require_numbers(path, require_field(path, entry, end, f"{name}."), f"{name}.{end}") for end in _ENDS]
        ends = [values * 3 if len(values) == 1 else values for values in ends]
        if any(len(values) != 3 for values in ends):
            raise DataError(path, f"'min' and 'max' of {name!r} are not three numbers each", REMEDY)
        if max(map(abs, ends[0] + ends[1])) > _LARGEST:
            raise DataError(path, f"'min' or 'max' of {name!r} is above {_LARGEST:g}", REMEDY)
        if "scale" in name and min(ends[0]) < 0:
            raise DataError(path, f"'min' of {name!r} is {min(ends[0]):g}, below 0", REMEDY)
        ranges[name] = np.array(ends)
    return ranges


_ENDS = ("min", "max")


def _read_index(file: Path, levels: int) -> tuple[Int64[ndarray, " squares"], Int64[ndarray, " squares"], int]:
    """Read counts and first bytes of the finest level, which comes first, and where all levels end."""
    record = np.dtype([("square", "<i2", 2), ("levels", [("count", "<i4"), ("start", "<i8"), ("size", "<i4")], levels)])
    if not file.is_file():
        raise DataError(file, "is missing", REMEDY)
    size = require_plain_file(file).stat().st_size
    if not size or size % record.itemsize:
        problem = f"{size} bytes are no whole number of records of {record.itemsize} bytes, for {levels} levels"
        raise DataError(file, problem, REMEDY)
    found = np.fromfile(file, record)["levels"]
    counts, starts, sizes = (found[name].astype(np.int64) for name in ("count", "start", "size"))
    wrong = (counts < 0) | (starts < 0) | (starts > _FARTHEST) | (starts % RECORD.itemsize != 0)
    wrong |= sizes < counts * RECORD.itemsize
    if wrong.any():
        row, level = np.argwhere(wrong)[0]
        problem = f"level {level} of record {row} has {counts[row, level]} splats in {sizes[row, level]} bytes"
        raise DataError(file, f"{problem} from byte {starts[row, level]}", REMEDY)
    end = int((starts + counts * RECORD.itemsize).max())
    return counts[:, 0], starts[:, 0], end
