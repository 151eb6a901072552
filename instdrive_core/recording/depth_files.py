"""Depth in metres as files: NumPy's arrays, or OpenEXR for programs that composite pictures."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Literal
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.extras import explain_missing_module

DepthFormat = Literal["npz", "exr"]
EXR_CHANNEL = "Z"
"""Channel that OpenEXR keeps for depth."""


def check_depth_format(form: DepthFormat) -> None:
    """Check that depth can be written so. Raises MissingExtraError where the package OpenEXR is missing."""
    if form == "exr":
        _load_openexr()


def encode_depth(depth: Float32[ndarray, "h w"], form: DepthFormat) -> bytes:
    """Encode metres without loss; 0 where nothing is.

    Raises MissingExtraError for `exr` without the package OpenEXR.
    """
    if form == "npz":
        packed = io.BytesIO()
        np.savez_compressed(packed, depth=depth)
        return packed.getvalue()
    library, packed = _load_openexr(), io.BytesIO()
    header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage}
    library.File(header, {EXR_CHANNEL: np.ascontiguousarray(depth)}).write(packed)
    return packed.getvalue()


def read_depth(stem: Path) -> Float32[ndarray, "h w"]:
    """Read metres of a recorded view, whose file has this path but for its ending, in whichever form there is.

    Raises DataError where there is no readable file, MissingExtraError for `exr` without the package OpenEXR.
    """
    path = stem.with_name(stem.name + ".npz")
    try:
        if path.is_file():
            with np.load(io.BytesIO(path.read_bytes())) as content:
                return content["depth"]
        path = path.with_suffix(".exr")
        opened = _load_openexr().File(io.BytesIO(path.read_bytes()), separate_channels=True)
        return opened.channels()[EXR_CHANNEL].pixels
    except (OSError, ValueError, KeyError, RuntimeError, EOFError, BadZipFile) as error:
        raise DataError(path, f"the depth cannot be read ({error})", "Record the drive again") from error


def _load_openexr():
    try:
        import OpenEXR
    except ModuleNotFoundError as error:
        raise explain_missing_module(error) or error from error
    return OpenEXR
