"""COLMAP's text model files. Where a comment tells the number of entries, it must be right."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from instdrive_core.datasets.colmap.model import REMEDY, ColmapImage, build_colmap_camera, invert_colmap_pose
from instdrive_core.datasets.distortion import AnyDistortion
from instdrive_core.datasets.posed_photos import ListedPoints, check_points
from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.scene.camera import Camera

_MOST_WORDS = 32
"""Most parameters of a camera; COLMAP's have up to 16."""
_MOST_DIGITS = 18
"""Most digits of a count; Python refuses to read thousands."""
_PROMISE = re.compile(r"#\s*Number of (?:cameras|images|points):\s*(\d+)")


def read_cameras(file: Path) -> dict[int, tuple[Camera, AnyDistortion]]:
    """``cameras.txt``. Raises DataError where anything about it is wrong."""
    cameras = {}
    for number, line in _read_entries(file, 1):
        words = line.split(maxsplit=_MOST_WORDS)
        if len(words) < 5:
            raise _build_error(file, number, line, "ID MODEL WIDTH HEIGHT PARAMETERS")
        camera_id, width, height = _parse_whole(file, number, [words[0], *words[2:4]])
        values = _parse_floats(file, number, words[4:])
        cameras[camera_id] = build_colmap_camera(file, camera_id, words[1], (width, height), values)
    return cameras


def read_images(file: Path) -> tuple[ColmapImage, ...]:
    """``images.txt`` without its observations. Raises DataError where anything about it is wrong."""
    images = []
    for number, line in _read_entries(file, 2):
        words = line.split(maxsplit=9)
        if len(words) != 10:
            raise _build_error(file, number, line, "ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
        pose = _parse_floats(file, number, words[1:8])
        image_id, camera_id = _parse_whole(file, number, [words[0], words[8]])
        name = words[9].strip()
        where = f"line {number}, image {image_id} ({name})"
        images.append(ColmapImage(name, camera_id, invert_colmap_pose(file, where, pose[:4], pose[4:])))
    return tuple(images)


def read_points(file: Path) -> ListedPoints:
    """``points3D.txt`` without its tracks. Raises DataError where anything about it is wrong."""
    points, colors = array("d"), bytearray()
    for number, line in _read_entries(file, 1):
        words = line.split(maxsplit=8)
        if len(words) < 8:
            raise _build_error(file, number, line, "ID X Y Z R G B ERROR TRACK")
        points.extend(_parse_floats(file, number, words[1:4]))
        color = _parse_whole(file, number, words[4:7])
        if max(color) > 255:
            raise _build_error(file, number, line, "R G B from 0 to 255")
        colors.extend(color)
    found = ListedPoints(np.array(points).reshape(-1, 3), np.frombuffer(colors, np.uint8).reshape(-1, 3))
    check_points(file, found.points)
    return found


def _read_entries(file: Path, lines_each: int) -> Iterator[tuple[int, str]]:
    """Number and first line of each entry; of the others only that they exist. Blank first lines are passed over."""
    promised, found = None, 0
    try:
        with require_plain_file(file).open(encoding="utf-8") as lines:
            numbered = enumerate(lines, 1)
            for number, line in numbered:
                promise = _PROMISE.match(line)
                promised = int(promise[1][:_MOST_DIGITS]) if promise else promised
                if line.startswith("#") or not line.strip():
                    continue
                for _ in range(lines_each - 1):
                    if next(numbered, None) is None and not line.endswith("\n"):
                        raise _build_error(file, number, line, "a line of observations after it, maybe empty")
                found += 1
                yield number, line
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(file, f"is no readable text ({error})", REMEDY) from error
    if promised is not None and promised != found:
        raise DataError(file, f"promises {promised} entries and holds {found}", REMEDY)


def _parse_floats(file: Path, number: int, words: Sequence[str]) -> list[float]:
    try:
        return [float(word) for word in words]
    except ValueError as error:
        raise _build_error(file, number, " ".join(words), "numbers") from error


def _parse_whole(file: Path, number: int, words: Sequence[str]) -> list[int]:
    if not all(word.isascii() and word.isdigit() and len(word) < 20 for word in words):
        raise _build_error(file, number, " ".join(words), "whole numbers")
    return [int(word) for word in words]


def _build_error(file: Path, number: int, found: str, expected: str) -> DataError:
    return DataError(file, f"line {number} holds {found.strip()[:120]!r}, expected {expected}", REMEDY)
