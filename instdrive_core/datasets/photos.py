"""Photo files: their sizes, and their pixels at the size that a clip wants."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from io import BufferedIOBase
from pathlib import Path
from typing import IO, cast

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import DataError
from instdrive_core.files.image_limit import BAD_IMAGE, check_pixels
from instdrive_core.files.plain_file import BoundedReader


def read_photo_size(photo: Path) -> tuple[int, int]:
    """Read width and height from the header alone. Raises DataError where it is no photo."""
    try:
        with BoundedReader(photo) as file, Image.open(file) as image:
            check_pixels(photo, image.size)
            return image.size
    except BAD_IMAGE as error:
        raise DataError(photo, f"is no readable photo ({error})", "Get the file again") from error


def load_photo(photo: Path, full_size: tuple[int, int], size: tuple[int, int]) -> UInt8[ndarray, "h w 3"]:
    """Load a photo in RGB, averaged down to `size` (width, height); JPEGs skip what their decoder can.

    Raises DataError where it is damaged or its size on disk is not `full_size`.
    """
    return decode_photo(photo, partial(BoundedReader, photo), full_size, size)


def decode_photo(
    photo: Path, opened: Callable[[], BufferedIOBase], full_size: tuple[int, int], size: tuple[int, int]
) -> UInt8[ndarray, "h w 3"]:
    """Decode a photo that may lie within another file, averaged down to `size` (width, height).

    Args:
        photo: the file, for messages.
        opened: opens the encoded photo.
        full_size: width and height that it must have.
        size: width and height to return.

    Raises DataError where it is damaged or of another size.
    """
    try:
        with opened() as file, Image.open(cast(IO[bytes], file)) as image:
            check_pixels(photo, image.size)
            if image.size != full_size:
                problem = f"is {image.size[0]}×{image.size[1]}, the camera's photos {full_size[0]}×{full_size[1]}"
                raise DataError(photo, problem, "Photos of one camera must have one size")
            image.draft("RGB", size)
            rgb = image.convert("RGB")
            return np.asarray(rgb if rgb.size == size else rgb.resize(size, Image.Resampling.BOX)).copy()
    except BAD_IMAGE as error:
        raise DataError(photo, f"is no readable photo ({error})", "Get the file again") from error
