"""Scenes in an .lcc: the finest level of each square of the ground, then the environment. z is up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.allocation import WHOLE, ReadOptions, allocate_gaussians
from instdrive_core.formats.lcc.meta import (
    DATA,
    ENVIRONMENT,
    ENVIRONMENT_RECORD,
    HARMONICS,
    HARMONICS_RECORD,
    RECORD,
    REMEDY,
    LccMeta,
    Range,
    get_meta_path,
    is_lcc_scene,
    list_lcc_files,
    read_lcc_meta,
    require_file,
)
from instdrive_core.formats.scene_format import FolderLayout, Format
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene, scene_from_gaussians

_REST = 15
_BLOCK_ROWS = 65536


def read_lcc(path: str | Path, options: ReadOptions = WHOLE) -> Scene:
    """Open the finest level of an .lcc, or of a folder with one, and its environment.

    Raises DataError where a file beside it is missing or too short, or counts do not fit.
    """
    path = Path(path)
    meta_path = get_meta_path(path)
    meta = read_lcc_meta(meta_path)
    data = require_file(meta_path, DATA, meta.end)
    harmonics = None
    if meta.has_harmonics:
        harmonics = require_file(meta_path, HARMONICS, meta.end // RECORD.itemsize * HARMONICS_RECORD.itemsize)
    environment = _read_environment(meta_path, meta)
    count = int(meta.counts.sum())
    total = count + len(environment)
    if not total:
        raise DataError(meta_path, "the scene has no splats", REMEDY)
    gaussians = allocate_gaussians(meta_path, total, _REST if meta.has_harmonics else 0, 0, options)
    first = 0
    for start, square_count in zip(meta.starts // RECORD.itemsize, meta.counts, strict=True):
        for row in range(0, int(square_count), _BLOCK_ROWS):
            block = min(_BLOCK_ROWS, int(square_count) - row)
            records = _read_rows(data, RECORD, int(start) + row, block, meta_path)
            words = harmonics and _read_rows(harmonics, HARMONICS_RECORD, int(start) + row, block, meta_path)["words"]
            _decode(records, words, meta, "", gaussians, first, options)
            first += block
        report(first / total)
    if len(environment):
        records, words = environment, None
        if meta.has_harmonics:
            records, words = environment["splat"], environment["words"]
        _decode(records, words, meta, "env", gaussians, first, options)
    return scene_from_gaussians(gaussians)


def _read_environment(path: Path, meta: LccMeta) -> ndarray:
    record = ENVIRONMENT_RECORD if meta.has_harmonics else RECORD
    if not (path.parent / ENVIRONMENT).is_file():
        return np.empty(0, record)
    file = require_file(path, ENVIRONMENT, 0)
    size = file.stat().st_size
    if size % record.itemsize:
        problem = f"{ENVIRONMENT} has {size} bytes, no whole number of splats of {record.itemsize} bytes"
        raise DataError(path, problem, REMEDY)
    return np.fromfile(file, record)


def _read_rows(file: Path, record: np.dtype, start: int, count: int, path: Path) -> ndarray:
    rows = np.fromfile(file, record, count, offset=start * record.itemsize)
    if len(rows) < count:
        raise DataError(path, f"{file.name} became shorter while it was read", "Open it again")
    return rows


def _decode(
    records: ndarray,
    words: ndarray | None,
    meta: LccMeta,
    prefix: str,
    gaussians: Gaussians,
    start: int,
    options: ReadOptions,
) -> None:
    """Decode splats into the rows from `start` on; `prefix` names whose ranges count."""
    source, rows = options.locate_rows(start, start + len(records))
    kept = records[source]
    scales = _mix(kept["scale"] / 65535.0, meta.get_range(prefix + "scale"))
    with np.errstate(divide="ignore", invalid="ignore"):  # flat splats; what is no number stays none
        gaussians.log_scales[rows] = np.log(scales)
        gaussians.means[rows] = kept["position"]
    color = kept["color"] / 255.0
    gaussians.sh_dc[rows] = dc_from_color(color[:, :3])
    gaussians.opacity_logits[rows] = logit(color[:, 3])
    gaussians.quats[rows] = _unpack_rotations(kept["rotation"])
    if words is not None:
        packed = words[source]
        colors = (packed & 2047) / 2047.0, (packed >> 11 & 1023) / 1023.0, (packed >> 21) / 2047.0
        gaussians.sh_rest[rows] = _mix(np.stack(colors, axis=2), meta.get_range(prefix + "shcoef"))


def _mix(shares: ndarray, ends: Range) -> ndarray:
    return (1 - shares) * ends[0] + shares * ends[1]


def _unpack_rotations(words: ndarray) -> ndarray:
    """Unpack quaternions wxyz from the three smaller of x, y, z, w (10 bits each) and the number of the largest."""
    smaller = np.stack([words >> shift & 1023 for shift in (0, 10, 20)], axis=1) / 1023.0 * np.sqrt(2) - np.sqrt(0.5)
    largest = np.sqrt(1 - np.minimum((smaller * smaller).sum(axis=1), 1.0))
    places = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[words >> 30]
    xyzw = np.empty((len(words), 4), np.float32)
    np.put_along_axis(xyzw, places, smaller.astype(np.float32), axis=1)
    np.put_along_axis(xyzw, (words >> 30).astype(np.int64)[:, None], largest[:, None].astype(np.float32), axis=1)
    return xyzw[:, [3, 0, 1, 2]]


LCC = Format(
    "XGRIDS LCC",
    ".lcc",
    read_lcc,
    up="+z",
    folder=FolderLayout(is_lcc_scene, list_lcc_files),
)
