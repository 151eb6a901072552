"""The largest picture that is read: headers are compared with it before any pixel is decoded."""

from __future__ import annotations

from pathlib import Path

from PIL import Image, UnidentifiedImageError

from instdrive_core.errors import DataError

MAX_PIXELS = 1 << 27
"""134 megapixels, 0.4 GB as RGB; cameras make photos of up to about 100."""

BAD_IMAGE = (
    *(OSError, UnidentifiedImageError, SyntaxError, ValueError),
    *(Image.DecompressionBombError, Image.DecompressionBombWarning),
)
"""Errors that Pillow raises for files that are no picture, half of one, or far larger than any."""

# Where nobody asks, Pillow itself warns beyond this, and refuses twice as much.
Image.MAX_IMAGE_PIXELS = MAX_PIXELS


def check_pixels(file: Path, size: tuple[int, int]) -> None:
    """Check a picture's width and height. Raises DataError where it is larger than any that is read."""
    width, height = size
    if width * height > MAX_PIXELS:
        problem = f"is {width}×{height}, {width * height:,} pixels; at most {MAX_PIXELS:,} are read"
        raise DataError(file, problem, "Scale the pictures down first")
