"""Numbers in the files of recordings, plain text and packed floats, and the poses that they make: each is checked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.files.text_file import read_text
from instdrive_core.maths.rotations import matrix_from_quaternion

FARTHEST = 1e9
"""Metres; no coordinate of a drive is larger."""
_REMEDY = "Get the file again"


def parse_numbers(file: Path, words: list[str], where: str) -> Float64[ndarray, " n"]:
    """Parse finite numbers. Raises DataError with the place for anything else."""
    try:
        values = np.array([float(word) for word in words], np.float64)
    except ValueError as error:
        raise DataError(file, f"{where} is no list of numbers ({str(error)[:80]})", _REMEDY) from error
    if not np.isfinite(values).all():
        raise DataError(file, f"{where} holds a value that is not finite", _REMEDY)
    return values


def read_number_text(file: Path, shape: tuple[int, ...]) -> Float64[ndarray, "..."]:
    """Read a text of nothing but numbers in the given shape. Raises DataError where there are more, fewer or others."""
    values = parse_numbers(file, read_text(file).split(), "the text")
    if len(values) != int(np.prod(shape)):
        problem = f"holds {len(values)} numbers, expected {'×'.join(map(str, shape))}"
        raise DataError(file, problem, _REMEDY)
    return values.reshape(shape)


def read_packed_floats(file: Path, columns: int) -> Float32[ndarray, "n c"]:
    """Read rows of little-endian 32-bit floats. Raises DataError where a row is not whole or a value not finite."""
    try:
        content = require_plain_file(file).read_bytes()
    except OSError as error:
        raise DataError(file, f"cannot be read ({error})", _REMEDY) from error
    if len(content) % (4 * columns):
        problem = f"has {len(content)} bytes, which are no whole rows of {columns} 32-bit numbers"
        raise DataError(file, problem, _REMEDY)
    rows = np.frombuffer(content, "<f4").reshape(-1, columns).astype(np.float32)
    wrong = np.flatnonzero(~(np.abs(rows) < FARTHEST).all(axis=1))
    if len(wrong):
        raise DataError(file, f"row {wrong[0]} holds {rows[wrong[0]].tolist()}, no usable point", _REMEDY)
    return rows


def require_pose(file: Path, matrix: Float[ndarray, "r c"], where: str) -> Float64[ndarray, "4 4"]:
    """Return a 4×4 pose of 3×4 or 4×4 numbers. Raises DataError where they are no rotation and position."""
    rotation = matrix[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):  # what is no rotation is refused below
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        is_rigid = error < 0.01 and np.linalg.det(rotation) > 0 and np.abs(matrix[:3, 3]).max() < FARTHEST
    if not is_rigid:  # NaN fails too
        problem = f"{where} is no rotation and position: {matrix.tolist()}"
        raise DataError(file, problem, _REMEDY)
    pose = np.eye(4)
    pose[:3] = matrix[:3]
    if error > 1e-12:
        left, _, right = np.linalg.svd(rotation)
        pose[:3, :3] = left @ right
    return pose


def build_pose(file: Path, quaternion: Any, position: Any, where: str) -> Float64[ndarray, "4 4"]:
    """Build a pose of a quaternion wxyz and a position in metres. Raises DataError where they are none."""
    turn, place = (_require_vector(file, value, where) for value in (quaternion, position))
    is_pose = len(turn) == 4 and len(place) == 3 and np.abs(turn).max() < 2 and np.abs(place).max() < FARTHEST
    if not is_pose or abs(np.linalg.norm(turn) - 1) > 0.01:
        problem = f"{where} is no rotation and position: {turn.tolist()}, {place.tolist()}"
        raise DataError(file, problem, _REMEDY)
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_quaternion(turn)
    pose[:3, 3] = place
    return pose


def _require_vector(file: Path, value: Any, where: str) -> Float64[ndarray, " n"]:
    values = value if isinstance(value, list | tuple | ndarray) else [value]
    is_number = [isinstance(entry, int | float | np.number) and not isinstance(entry, bool) for entry in values]
    try:
        vector = np.array(values, np.float64) if all(is_number) and len(values) <= 16 else np.full(1, np.nan)
    except OverflowError:
        vector = np.full(1, np.nan)
    if not np.isfinite(vector).all():
        raise DataError(file, f"{where} holds {str(value)[:120]!r}, expected numbers", _REMEDY)
    return vector


def require_sizes(file: Path, sizes: Float[ndarray, " n"], where: str) -> None:
    """Check the metres of a box's sides. Raises DataError where one is not positive or absurdly large."""
    if not ((sizes > 0) & (sizes < 1e4)).all():  # NaN fails too
        raise DataError(file, f"{where} has the size {np.asarray(sizes).tolist()}, expected metres above 0", _REMEDY)


def invert_pose(pose: Float64[ndarray, "4 4"]) -> Float64[ndarray, "4 4"]:
    """Invert a rigid transform."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


FORWARD_X = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
"""Box whose length lies along x, from one whose length lies along y as a track's does."""
CAR_FROM_OPENCV = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Axes of a car (x forward, y left, z up) from a camera's that looks forward."""
