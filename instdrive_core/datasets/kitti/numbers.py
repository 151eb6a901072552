"""KITTI's text files: calibrations by name, poses of the GPS, times with nanoseconds."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.recording import Pose
from instdrive_core.datasets.rig_files import parse_numbers, require_pose
from instdrive_core.errors import DataError
from instdrive_core.files.text_file import read_text

EARTH_RADIUS = 6_378_137.0
"""Metres, as KITTI's devkit projects."""
OXTS_FIELDS = 30
_REMEDY = "Get the file again"
_TIME = re.compile(r"(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d)(?:\.(\d{1,9}))?")


def read_named_numbers(file: Path) -> dict[str, Float64[ndarray, " n"]]:
    """Read lines such as ``P2: 7.2e+02 …`` by name, with or without the colon; lines of words are left out."""
    found = {}
    for line in read_text(file).splitlines():
        name, *words = line.split()[:40] or [""]
        if words and _is_number(words[0]):
            found[name.rstrip(":")] = parse_numbers(file, words, f"the line '{name[:40]}'")
    return found


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def require_matrix(
    file: Path, found: dict[str, Float64[ndarray, " n"]], names: tuple[str, ...], shape: tuple[int, int]
) -> Float64[ndarray, "r c"]:
    """Return the matrix that stands under the first of the names. Raises DataError where it is missing or too short."""
    name = next((name for name in names if name in found), None)
    if name is None:
        raise DataError(file, f"the line '{names[0]}' is missing", _REMEDY)
    if len(found[name]) != shape[0] * shape[1]:
        problem = f"the line '{name}' has {len(found[name])} numbers, expected {shape[0]}×{shape[1]}"
        raise DataError(file, problem, _REMEDY)
    return found[name].reshape(shape)


def require_transform(file: Path, found: dict[str, Float64[ndarray, " n"]], names: tuple[str, ...]) -> Pose:
    """Return the rigid transform of 3×4 numbers under the first of the names."""
    return require_pose(file, require_matrix(file, found, names, (3, 4)), f"the line '{names[0]}'")


def require_rotation(file: Path, found: dict[str, Float64[ndarray, " n"]], names: tuple[str, ...]) -> Pose:
    """Return the rotation of 3×3 numbers under the first of the names, as a transform."""
    turn = np.column_stack([require_matrix(file, found, names, (3, 3)), np.zeros(3)])
    return require_pose(file, turn, f"the line '{names[0]}'")


def read_times(file: Path) -> list[float]:
    """Read a time a line as seconds."""
    return [_parse_time(file, row, line) for row, line in enumerate(read_text(file).splitlines()) if line.strip()]


def _parse_time(file: Path, row: int, line: str) -> float:
    match = _TIME.fullmatch(line.strip())
    try:
        whole = datetime.strptime(match[1] if match else "", "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC)
    except ValueError as error:
        raise DataError(file, f"line {row + 1} is no time: {line[:60]!r}", _REMEDY) from error
    assert match is not None
    return whole.timestamp() + float(f"0.{match[2] or 0}")


def format_time(seconds: float) -> str:
    """Write seconds as KITTI writes a time."""
    nanoseconds = round(seconds * 1e9)
    whole = datetime.fromtimestamp(nanoseconds // 10**9, UTC)
    return f"{whole:%Y-%m-%d %H:%M:%S}.{nanoseconds % 10**9:09d}"


def pose_from_oxts(file: Path, values: Float64[ndarray, " n"], scale: float) -> Pose:
    """Compute world from IMU (east, north, up; x forward, y left, z up) from latitude, longitude, altitude and angles.

    Args:
        file: for messages.
        values: a line of an oxts file.
        scale: of the Mercator projection: the cosine of the first latitude.
    """
    if len(values) < 6 or not (abs(values[0]) < 89 and abs(values[1]) <= 360 and abs(values[2]) < 1e5):
        raise DataError(file, f"latitude, longitude, altitude are {values[:3].tolist()}, no place on Earth", _REMEDY)
    latitude, longitude, altitude, roll, pitch, yaw = values[:6]
    pose = np.eye(4)
    pose[:3, :3] = _turn(yaw, 2) @ _turn(pitch, 1) @ _turn(roll, 0)
    north = np.log(np.tan((90 + latitude) * np.pi / 360))
    pose[:3, 3] = scale * EARTH_RADIUS * np.radians(longitude), scale * EARTH_RADIUS * north, altitude
    return pose


def oxts_from_pose(pose: Pose, scale: float) -> list[float]:
    """Compute the line of an oxts file whose pose this is; all but place and angles are 0."""
    east, north, altitude = pose[:3, 3]
    latitude = np.degrees(2 * np.arctan(np.exp(north / (scale * EARTH_RADIUS)))) - 90
    longitude = np.degrees(east / (scale * EARTH_RADIUS))
    turn = pose[:3, :3]
    roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    pitch = np.arctan2(-turn[2, 0], np.hypot(turn[2, 1], turn[2, 2]))
    return [float(value) for value in (latitude, longitude, altitude, roll, pitch, yaw)] + [0.0] * (OXTS_FIELDS - 6)


def _turn(angle: float, axis: int) -> Float64[ndarray, "3 3"]:
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[[one, other], [one, other]] = np.cos(angle)
    turn[other, one] = np.sin(angle)
    turn[one, other] = -np.sin(angle)
    return turn
