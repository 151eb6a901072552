"""The file in a run's folder that says which splat of another scene each of its own comes from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Int64
from numpy import ndarray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes

PARENTS = "parents.safetensors"
_NAME = "parents"


def write_parents(run: Path, parents: Int64[ndarray, " m"]) -> None:
    """Write the parents of a run's splats: rows of the scene that it was trained on from, its own first, in order."""
    write_bytes(run / PARENTS, save({_NAME: np.ascontiguousarray(parents, np.int64)}))


def read_parents(run: Path, base_splats: int) -> Int64[ndarray, " m"]:
    """Read what `write_parents` wrote, for a base of so many splats. Raises DataError where it misfits."""
    path, remedy = run / PARENTS, "Improve the scene again into another folder"
    try:
        parents = load(path.read_bytes())[_NAME]
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise DataError(path, f"cannot be read ({error})", remedy) from error
    if parents.dtype != np.int64 or parents.ndim != 1 or len(parents) < base_splats:
        raise DataError(path, f"is no list of at least {base_splats} whole numbers", remedy)
    if not np.array_equal(parents[:base_splats], np.arange(base_splats)) or parents.max(initial=0) >= max(
        base_splats, 1
    ):
        raise DataError(path, f"belongs to another scene than one of {base_splats:,} splats", remedy)
    return parents
