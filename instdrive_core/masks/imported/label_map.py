"""Label maps made elsewhere: grey PNGs of 8 or 16 bits, 0 = none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import DataError
from instdrive_core.files.image_limit import BAD_IMAGE
from instdrive_core.files.plain_file import BoundedReader
from instdrive_core.masks.imported.checks import MAX_MASKS, REMEDY, check_count, check_size
from instdrive_core.masks.label_map_folder import read_label_map, resample_nearest


def read_imported_label_map(file: Path, width: int, height: int) -> UInt32[ndarray, "h w"]:
    """Read labels at a photo's size. Raises DataError for a file that is none, or not of this photo."""
    try:
        with BoundedReader(file) as stream, Image.open(stream) as image:  # reads the header only
            size = image.size
    except BAD_IMAGE as error:
        raise DataError(file, f"is no readable PNG ({error})", REMEDY) from error
    check_size(file, "the label map", size, (width, height))
    labels = read_label_map(file)
    low, high = int(labels.min()), int(labels.max())
    if low < 0 or high > MAX_MASKS:
        problem = f"holds the label {low if low < 0 else high}, expected 0 to {MAX_MASKS}"
        raise DataError(file, problem, "Number the masks of each photo from 1")
    check_count(file, "the label map", int(high > 0))
    return resample_nearest(labels, width, height).astype(np.uint32)
