"""Tables as gzipped pickles of plain DataFrames, as PandaSet has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.maths.rotations import quaternion_from_matrix


def write_table(path: Path, columns: dict[str, ndarray], index_name: str | None = None) -> None:
    """Write a gzipped pickle of a plain DataFrame: numpy columns, texts and column names as objects rather than pandas'
    own strings (which need pyarrow where that is installed), no time of day in the gzip header."""
    import pandas as pd

    texts = {name: pd.Series(values, dtype=object) for name, values in columns.items() if values.dtype.kind in "OU"}
    table = pd.DataFrame(columns | texts)
    table.columns = pd.Index(list(columns), dtype=object)
    table.index.name = index_name
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_pickle(path, compression={"method": "gzip", "compresslevel": 1, "mtime": 0}, protocol=4)


def describe_pose(pose: Float64[ndarray, "4 4"]) -> dict[str, dict[str, float]]:
    """Describe a pose as PandaSet does: position and quaternion wxyz."""
    quaternion = quaternion_from_matrix(pose[:3, :3])
    return {
        "position": dict(zip("xyz", map(float, pose[:3, 3]), strict=True)),
        "heading": dict(zip("wxyz", map(float, quaternion), strict=True)),
    }


def build_object_column(values: list[object]) -> ndarray:
    """Build a column of Python objects."""
    column = np.empty(len(values), object)
    column[:] = values
    return column
