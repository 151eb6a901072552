"""The pictures of a video or of a folder, one after the other, and how sharp each is and how far it moved."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import DataError
from instdrive_core.files.image_limit import BAD_IMAGE, check_pixels

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")
PHOTOS = (".jpg", ".jpeg", ".png", ".webp")
_LOOKED_AT = 320
"""Pixels of width at which pictures are compared."""
_FOLLOWED = 400
"""Corners followed from picture to picture."""


@dataclass(frozen=True)
class Candidate:
    """A picture that may become one of the clip."""

    number: int
    """Its place in the video or folder."""
    sharpness: float
    """Variance of the Laplacian of its grey values; comparable between neighbours only."""
    shift: float
    """Median way of corners since the picture before, as a share of the width; 1 where none could be followed."""


def list_photo_files(folder: Path) -> list[Path]:
    """List a folder's photos by name. Raises DataError where it has none."""
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in PHOTOS and file.is_file())
    if not files:
        raise DataError(folder, f"holds no photo ({', '.join(PHOTOS)})", "Give a folder of photos, or a video")
    return files


def read_pictures(source: Path) -> Iterator[tuple[int, UInt8[ndarray, "h w 3"]]]:
    """Read a video's or folder's pictures in RGB, each with its number.

    Raises DataError where the source is neither, or where a picture cannot be decoded.
    """
    if source.is_dir():
        for number, file in enumerate(list_photo_files(source)):
            yield number, _read_photo(file)
        return
    import cv2

    if not source.is_file():
        raise DataError(source, "there is no such file or folder", "Give a video or a folder of photos")
    video = cv2.VideoCapture(str(source))
    try:
        number = 0
        while True:
            found, picture = video.read()
            if not found:
                break
            yield number, np.ascontiguousarray(picture[:, :, ::-1])
            number += 1
    finally:
        video.release()
    if number == 0:
        problem = "holds no picture that can be decoded"
        raise DataError(source, problem, f"Give a video ({', '.join(VIDEOS)}) or a folder of photos")


def measure_candidates(source: Path, on_picture: Callable[[int], None]) -> list[Candidate]:
    """Measure all pictures of a source; `on_picture` is told how many are done. Raises as `read_pictures`."""
    import cv2

    found: list[Candidate] = []
    before: ndarray | None = None
    for number, picture in read_pictures(source):
        height, width = picture.shape[:2]
        size = _LOOKED_AT, max(1, round(height * _LOOKED_AT / width))
        grey = cv2.cvtColor(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
        sharpness = float(cv2.Laplacian(grey, cv2.CV_64F).var())
        shift = 1.0 if before is None or before.shape != grey.shape else _measure_shift(before, grey)
        found.append(Candidate(number, sharpness, shift))
        before = grey
        on_picture(len(found))
    return found


def _measure_shift(before: UInt8[ndarray, "h w"], after: UInt8[ndarray, "h w"]) -> float:
    import cv2

    corners = cv2.goodFeaturesToTrack(before, _FOLLOWED, 0.01, 5)
    if corners is None:
        return 1.0
    places, status, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, np.empty_like(corners))
    kept = status.ravel() == 1
    if kept.sum() < 10:
        return 1.0
    return float(np.median(np.linalg.norm((places - corners).reshape(-1, 2)[kept], axis=1))) / before.shape[1]


def _read_photo(file: Path) -> UInt8[ndarray, "h w 3"]:
    try:
        with Image.open(file) as image:
            check_pixels(file, image.size)
            return np.asarray(image.convert("RGB"))
    except BAD_IMAGE as error:
        raise DataError(file, f"is no readable photo ({error})", "Take it out of the folder") from error
