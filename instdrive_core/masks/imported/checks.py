"""Checks of every importer of masks: they must be of the photo, and not larger than any photo's."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.errors import DataError

MAX_PIXELS = 1 << 26
"""Most pixels of a mask; larger ones are not read."""
MAX_MASKS = 65535
"""Most masks of a photo: labels have 16 bits."""
REMEDY = "Make the masks again from this clip's photos; docs/masks.md tells what is read"


def check_size(file: Path, what: str, mask_size: tuple[int, int], photo_size: tuple[int, int]) -> None:
    """Raise DataError where masks cannot be of a photo: another shape than the photo scaled to any size.

    Args:
        file: to be named.
        what: part of the file that holds the size, e.g. ``the field 'masks'``.
        mask_size: width, height.
        photo_size: width, height.
    """
    width, height = mask_size
    photo_width, photo_height = photo_size
    if width < 1 or height < 1:
        raise DataError(file, f"{what} is {width}×{height}: there is nothing in it", REMEDY)
    if width * height > MAX_PIXELS:
        raise DataError(file, f"{what} is {width}×{height}, larger than the {MAX_PIXELS} pixels that are read", REMEDY)
    # Either side of a scaled photo may have been rounded up or down.
    if abs(width * photo_height - height * photo_width) >= max(photo_width, photo_height):
        problem = f"{what} is {width}×{height}, of another shape than the photo with {photo_width}×{photo_height}"
        raise DataError(file, problem, REMEDY)


def check_count(file: Path, what: str, count: int) -> None:
    """Raise DataError for no mask, or more than a label map can tell apart."""
    if count < 1:
        remedy = "Make them again, or leave the photo out with --cameras, --first or --last"
        raise DataError(file, f"{what} holds no mask", remedy)
    if count > MAX_MASKS:
        raise DataError(file, f"{what} holds {count} masks, more than {MAX_MASKS} labels tell apart", REMEDY)
