"""PandaSet's LiDAR sweeps with their semantic classes."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from jaxtyping import Float64, UInt8, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import SweepPoints
from instdrive_core.errors import DataError
from instdrive_core.files.numpy_file import BAD_ARRAY, read_number_array
from instdrive_core.files.restricted_pickle import read_pickle

logger = logging.getLogger(__name__)

FARTHEST = 1e9
"""Metres; no coordinate of a drive is larger."""


def find_numbered_pickle(folder: Path, index: int) -> Path | None:
    """Find ``NN.pkl.gz`` or ``NN.pkl`` in a folder; None where there is neither."""
    candidates = (folder / f"{index:02d}{suffix}" for suffix in (".pkl.gz", ".pkl"))
    return next((file for file in candidates if file.is_file()), None)


def load_sweep(root: Path, index: int, origin: Float64[ndarray, "3"], start: float = 0.0) -> SweepPoints:
    """Load the sweep of a time step relative to `origin`, with semantic classes and exact instances where the clip has
    them.

    `start` is the moment that the clip counts its seconds from, as the sweep's column ``t`` counts.

    Raises DataError where a file is missing or damaged, or a value in it is not finite.
    """
    file = find_numbered_pickle(root / "lidar", index)
    if file is None:
        raise DataError(root / "lidar", f"the sweep {index:02d} is missing", "Load the clip again")
    table = read_pickle(file)
    columns = [_read_numeric_column(file, table, name) for name in ("x", "y", "z", "i")]
    sensor = _read_byte_column(file, table, "d") if "d" in table else np.zeros(len(columns[0]), np.uint8)
    if max(np.abs(column).max(initial=0) for column in columns[:3]) >= FARTHEST:
        raise DataError(file, f"a point lies farther than {FARTHEST:g} m", "Get the file again")
    points = np.stack(columns[:3], axis=1) - origin
    return SweepPoints(
        points=points.astype(np.float32),
        intensity=np.clip(columns[3] / 255, 0, 1).astype(np.float32),
        sensor=sensor,
        classes=_load_classes(root, index, len(points)),
        instance_labels=_load_instance_labels(root, index, len(points)),
        times=_read_numeric_column(file, table, "t") - start if "t" in table else None,
    )


def _read_numeric_column(file: Path, table: dict[str, ndarray], name: str) -> Float64[ndarray, " n"]:
    if name not in table:
        raise DataError(file, f"the column '{name}' is missing, found {', '.join(table)}", "Get the file again")
    if table[name].dtype.kind not in "fiu":
        raise DataError(file, f"the column '{name}' holds no numbers", "Get the file again")
    column = table[name].astype(np.float64)
    if not np.isfinite(column).all():
        raise DataError(file, f"the column '{name}' holds values that are not finite", "Get the file again")
    return column


def _read_byte_column(file: Path, table: dict[str, ndarray], name: str) -> UInt8[ndarray, " n"]:
    """Read a column of small whole numbers: classes, or which LiDAR it was."""
    column = _read_numeric_column(file, table, name)
    wrong = np.flatnonzero((column < 0) | (column > 255) | (column != np.floor(column)))
    if len(wrong):
        problem = f"the column '{name}' holds {column[wrong[0]]:g} in row {wrong[0]}, not a whole number from 0 to 255"
        raise DataError(file, problem, "Get the file again")
    return column.astype(np.uint8)


def _load_classes(root: Path, index: int, count: int) -> UInt8[ndarray, " n"] | None:
    """Load semantic classes row by row; None where there are none, or not as many as points (a known fault)."""
    file = find_numbered_pickle(root / "annotations" / "semseg", index)
    if file is None:
        return None
    classes = _read_byte_column(file, read_pickle(file), "class")
    if len(classes) != count:
        logger.warning("%s: %d classes for %d points; going on without them", file, len(classes), count)
        return None
    return classes


def _load_instance_labels(root: Path, index: int, count: int) -> UInt32[ndarray, " n"] | None:
    """Load the exact instance of each point, as synthetic clips have them."""
    file = root / "labels" / "lidar" / f"{index:02d}.npy"
    if not file.is_file():
        return None
    try:
        labels = read_number_array(file, count)
    except BAD_ARRAY as error:
        raise DataError(file, f"is no readable array ({error})", "Write the synthetic clip again") from error
    if labels.shape != (count,) or labels.dtype.kind not in "iu":
        problem = f"holds {labels.dtype} of shape {labels.shape} for {count} points"
        raise DataError(file, problem, "Write the synthetic clip again")
    return labels.astype(np.uint32)
