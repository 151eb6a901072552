"""Masks made elsewhere as NumPy archives, e.g. saved from a segmenter: boolean arrays (masks, height, width).

Arrays are read one mask at a time, after their headers were checked, and nothing pickled is ever loaded.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.numpy_file import BAD_ARRAY, read_array_header
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.masks.image.painting import Painting
from instdrive_core.masks.imported.checks import REMEDY, check_count, check_size
from instdrive_core.masks.label_map_folder import resample_nearest

ARRAYS = ("masks", "segmentations")
"""Names of the array, the first that is there."""
MAX_BYTES = 1 << 34
"""Most bytes of an unpacked array."""
_REMEDY = "Save it with numpy.savez_compressed(FILE, masks=...), booleans of shape (masks, height, width)"


def read_imported_npz(file: Path, width: int, height: int) -> UInt32[ndarray, "h w"]:
    """Read masks as labels at a photo's size. Raises DataError for a file that is none, or not of this photo."""
    painting = Painting(height, width)
    try:
        with zipfile.ZipFile(require_plain_file(file)) as archive:
            name = _find_array(file, archive)
            with archive.open(f"{name}.npy") as stream:
                for number, mask in enumerate(_read_masks(file, name, stream, (width, height))):
                    if not mask.any():
                        raise DataError(file, f"the mask {number} of '{name}' is empty", "Leave empty masks out")
                    painting.add(resample_nearest(mask, width, height))
    except FileNotFoundError as error:
        raise DataError(file, "is missing", REMEDY) from error
    except BAD_ARRAY as error:
        raise DataError(file, f"is no readable .npz archive ({error})", _REMEDY) from error
    return painting.labels


def _find_array(file: Path, archive: zipfile.ZipFile) -> str:
    members = set(archive.namelist())
    for name in ARRAYS:
        if f"{name}.npy" in members:
            return name
    held = ", ".join(sorted(member.removesuffix(".npy") for member in members)[:8]) or "nothing"
    raise DataError(file, f"has no array '{ARRAYS[0]}' or '{ARRAYS[1]}', but {held}", _REMEDY)


def _read_masks(
    file: Path, name: str, stream: IO[bytes], photo_size: tuple[int, int]
) -> Iterator[Bool[ndarray, "h w"]]:
    """One mask after the other."""
    shape, fortran_order, dtype = read_array_header(stream)
    what = f"the field '{name}'"
    if dtype.hasobject:
        raise DataError(file, f"{what} holds Python objects, which are never loaded", _REMEDY)
    if len(shape) != 3:
        raise DataError(file, f"{what} has the shape {shape}, expected (masks, height, width)", _REMEDY)
    if dtype.kind not in "bui":
        raise DataError(file, f"{what} has the type {dtype}, expected booleans", _REMEDY)
    if fortran_order and shape[0] > 1:
        raise DataError(file, f"{what} is stored column by column", "Save numpy.ascontiguousarray of it")
    count, height, width = shape
    check_count(file, what, count)
    check_size(file, what, (width, height), photo_size)
    if count * height * width * dtype.itemsize > MAX_BYTES:
        raise DataError(file, f"{what} takes more than {MAX_BYTES >> 30} GiB", _REMEDY)
    for number in range(count):
        content = stream.read(height * width * dtype.itemsize)
        if len(content) != height * width * dtype.itemsize:
            raise DataError(file, f"{what} ends within the mask {number} of {count}", "Get the file again")
        mask = np.frombuffer(content, np.dtype(np.uint8) if dtype.kind == "b" else dtype).reshape(height, width)
        value = mask.max()
        if dtype.kind != "b" and not ((mask == 0) | (mask == value)).all():
            problem = f"{what} holds more than 0 and {value} in the mask {number}"
            raise DataError(file, problem, "Save booleans; label maps are imported as PNG")
        yield mask != 0
