"""Masks made elsewhere as JSON with COCO's run lengths, as Segment Anything's mask generator writes them.

A list of objects whose ``segmentation`` has ``size`` (height, width) and ``counts`` (a string, or a list of numbers),
or an object with such a list as ``annotations``.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

from jaxtyping import Bool, UInt32
from numpy import ndarray
from pycocotools import mask as coco

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field
from instdrive_core.masks.image.painting import Painting
from instdrive_core.masks.imported.checks import REMEDY, check_count, check_size
from instdrive_core.masks.label_map_folder import resample_nearest

_COUNTS = re.compile(r"(?:[P-o]{0,6}[0-O])++")
"""Run lengths, 5 bits a character: `P` to `o` say that the next character goes on with the number. The decoder in C
would read on behind a string that ends so."""


def read_imported_rle(file: Path, width: int, height: int) -> UInt32[ndarray, "h w"]:
    """Read masks as labels at a photo's size. Raises DataError for a file that is none, or not of this photo."""
    content = read_json(file)
    where = ""
    if isinstance(content, dict):
        content, where = require_field(file, content, "annotations"), "annotations"
    if not isinstance(content, list):
        raise DataError(file, f"holds {type(content).__name__}, expected a list of masks", REMEDY)
    check_count(file, f"the field '{where}'" if where else "the list", len(content))
    painting = Painting(height, width)
    for number, entry in enumerate(content):
        name = f"{where}[{number}].segmentation"
        mask = _decode(file, name, require_field(file, entry, "segmentation", f"{where}[{number}]."), (width, height))
        if not mask.any():
            raise DataError(file, f"the field '{name}' is an empty mask", "Leave empty masks out")
        painting.add(resample_nearest(mask, width, height))
    return painting.labels


def _decode(file: Path, name: str, segmentation: Any, photo_size: tuple[int, int]) -> Bool[ndarray, "h w"]:
    if not isinstance(segmentation, dict):
        problem = f"the field '{name}' is no object with 'size' and 'counts' but {type(segmentation).__name__}"
        raise DataError(file, problem, "Polygons are not read: write run lengths")
    size, counts = (require_field(file, segmentation, key, f"{name}.") for key in ("size", "counts"))
    if not isinstance(size, list) or len(size) != 2 or not all(type(side) is int for side in size):
        raise DataError(file, f"the field '{name}.size' is {size!r}, expected [height, width]", REMEDY)
    height, width = size
    check_size(file, f"the field '{name}.size'", (width, height), photo_size)
    run_lengths = _prepare_run_lengths(file, f"{name}.counts", counts, height, width)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # pycocotools 2.0.11 makes its arrays as NumPy 1 did
            return coco.decode(run_lengths).astype(bool)
    except ValueError as error:  # runs longer than the mask
        raise DataError(file, f"the field '{name}.counts' cannot be decoded ({error})", REMEDY) from error


def _prepare_run_lengths(file: Path, name: str, counts: Any, height: int, width: int) -> Any:
    """Prepare run lengths as the decoder reads them."""
    if isinstance(counts, str):
        if not _COUNTS.fullmatch(counts):
            raise DataError(file, f"the field '{name}' is {counts[:40]!r}, which is no text of run lengths", REMEDY)
        return {"size": [height, width], "counts": counts.encode("ascii")}
    if not isinstance(counts, list) or not all(type(run) is int and run >= 0 for run in counts):
        raise DataError(file, f"the field '{name}' is neither a text nor a list of run lengths", REMEDY)
    if sum(counts) != height * width:
        raise DataError(file, f"the field '{name}' covers {sum(counts)} pixels of {height * width}", REMEDY)
    plain: Any = {"size": [height, width], "counts": counts}  # the decoder's types do not know this form
    return coco.frPyObjects(plain, height, width)
