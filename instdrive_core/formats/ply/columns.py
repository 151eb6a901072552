"""The properties of a .ply and the values they hold: the INRIA layout and InstDrive's extra columns."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.instances.colormap import ID_LIMIT
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.scene.gaussians import Gaussians

REQUIRED = (
    *("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)
NORMALS = ("nx", "ny", "nz")
TYPE_NAMES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}
"""Names of types in a .ply's header, by NumPy's kinds."""
ID_LIMITS = {"instance_id": ID_LIMIT, "codeword": 1 << 32}
"""Whole-number columns and the first value that does not fit them."""


def check_columns(names: tuple[str, ...], path: Path) -> tuple[int, int]:
    """Check the names of columns; returns the number of SH coefficients above the constant and the feature dimension.

    Raises DataError where a column is missing.
    """
    missing = [name for name in REQUIRED if name not in names]
    if missing == ["scale_2"]:
        problem = "the splats have two sizes and no scale_2: it is a file of 2D Gaussians (2DGS), which are flat discs"
        remedy = "Train 3D Gaussians, or give every splat a thickness: a column scale_2 of e.g. -12, its logarithm"
        raise DataError(path, problem, remedy)
    if missing:
        problem = f"the columns {', '.join(missing)} are missing"
        raise DataError(path, problem, "Only .ply files of 3D Gaussians or of bare points can be opened")
    rest, features = _count_numbered("f_rest_", names, path), _count_numbered("feature_", names, path)
    if rest % 3 or rest // 3 not in REST_COUNTS:
        counts = ", ".join(str(3 * count) for count in REST_COUNTS)
        raise DataError(path, f"{rest} f_rest columns fit no SH degree", f"There must be one of {counts}")
    return rest // 3, features


def view_columns(gaussians: Gaussians) -> dict[str, ndarray]:
    """View each INRIA property (n,) in the Gaussians' arrays, in the order INRIA writes them (without normals)."""
    views = {name: gaussians.means[:, axis] for axis, name in enumerate("xyz")}
    views |= {f"f_dc_{channel}": gaussians.sh_dc[:, channel] for channel in range(3)}
    rest = gaussians.sh_rest.shape[1]
    views |= {f"f_rest_{index}": gaussians.sh_rest[:, index % rest, index // rest] for index in range(3 * rest)}
    views["opacity"] = gaussians.opacity_logits
    views |= {f"scale_{axis}": gaussians.log_scales[:, axis] for axis in range(3)}
    views |= {f"rot_{axis}": gaussians.quats[:, axis] for axis in range(4)}
    return views


def view_features(gaussians: Gaussians) -> dict[str, ndarray]:
    """View each feature (n,) in the Gaussians' array, by its column's name ``feature_0`` …"""
    return {f"feature_{index}": gaussians.features[:, index] for index in range(gaussians.features.shape[1])}


def check_whole_numbers(values: ndarray, name: str, path: Path) -> None:
    """Check that IDs, of any numeric type, are whole numbers in range. Raises DataError."""
    limit = ID_LIMITS[name]
    # Written so that NaN fails too.
    wrong = np.flatnonzero(~((values >= 0) & (values < limit) & (values == np.floor(values))))
    if len(wrong):
        problem = f"column {name!r} holds {values[wrong[0]]}, not a whole number from 0 to {limit - 1}"
        raise DataError(path, problem, "Remove the column or write it as uint")


def check_extra_column(name: str, column: ndarray) -> None:
    """Check that a .ply can hold a column that no program knows. Raises ValueError."""
    if not name.isprintable() or name.split() != [name]:
        raise ValueError(f"{name!r} is no name of a column")
    if name in (*REQUIRED, *ID_LIMITS) or re.fullmatch(r"(f_rest|feature)_\d+", name):
        raise ValueError(f"the column {name!r} stands twice")
    if column.dtype.newbyteorder("=").str[1:] not in TYPE_NAMES:
        raise ValueError(f"the column {name!r} holds {column.dtype}, none of {', '.join(TYPE_NAMES.values())}")


def _count_numbered(prefix: str, names: tuple[str, ...], path: Path) -> int:
    numbers = {int(match[1]) for name in names if (match := re.fullmatch(re.escape(prefix) + r"(\d{1,6})", name))}
    if numbers != set(range(len(numbers))):
        gap = min(set(range(len(numbers))) - numbers)
        raise DataError(
            path, f"{len(numbers)} columns are called {prefix}…, but {prefix}{gap} is missing", "Export again"
        )
    return len(numbers)
