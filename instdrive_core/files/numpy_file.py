"""Arrays in .npy files, and what NumPy raises for damaged ones.

NumPy itself takes memory by what a header promises: its own length, and the number of values.
"""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import IO

import numpy as np
from numpy import ndarray
from numpy.lib import format as npy

from instdrive_core.files.plain_file import require_plain_file

BAD_ARRAY = (
    *(OSError, EOFError, ValueError, TypeError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error),
    # Headers are Python literals, and those of old versions are taken apart as Python source.
    *(tokenize.TokenError, SyntaxError, RecursionError),
)
_MAX_HEADER = 1 << 16


def read_array_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Read an array's shape, whether columns come first, and its type. Raises one of `BAD_ARRAY` for a damaged one."""
    version = npy.read_magic(stream)
    if version == (1, 0):
        return npy.read_array_header_1_0(stream)
    if version == (2, 0):
        return npy.read_array_header_2_0(stream)
    raise ValueError(f"array format {version[0]}.{version[1]}")


def read_number_array(file: Path, most: int) -> ndarray:
    """Read a .npy file of at most `most` numbers. Raises one of `BAD_ARRAY` where it is damaged."""
    limit = _MAX_HEADER + most * np.dtype(np.float64).itemsize
    with require_plain_file(file).open("rb") as stream:
        content = stream.read(limit + 1)
    if len(content) > limit:
        raise ValueError(f"it is larger than {most} values can be")
    start = io.BytesIO(content)
    shape, fortran_order, dtype = read_array_header(start)
    if dtype.kind not in "biuf":
        raise ValueError(f"it holds {dtype}, not numbers")
    if math.prod(shape) * dtype.itemsize != len(content) - start.tell():
        problem = f"the header promises {dtype} of shape {shape}, {len(content) - start.tell()} bytes are there"
        raise ValueError(problem)
    flat = np.frombuffer(content, dtype, offset=start.tell())
    return flat.reshape(shape, order="F" if fortran_order else "C")
