"""Reads tables out of pandas pickles without running anything they ask for.

A pickle is a program that may call whatever it can name, and PandaSet's files come from mirrors. Here each name on the
allow list stands for a record that only remembers its arguments; nothing of numpy or pandas is called while the
pickle is read, and every other name is refused. The columns are then taken out of the records
(`pickled_table.py`), so that files written by any version of pandas read the same.
"""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

from numpy import ndarray

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.files.pickled_table import (
    ArrayFromBytes,
    ArrayShell,
    Block,
    BlockManager,
    DataFrame,
    DataType,
    EncodedText,
    ExtensionArray,
    Index,
    Name,
    Recorded,
    Scalar,
    Slice,
    extract_columns,
)
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.files.recording_unpickler import TRUST_REMEDY, RecordingUnpickler

MAX_DECOMPRESSED_BYTES = 64 * 2**20
"""Limit for one unpacked file; a PandaSet sweep unpacks to 8 MB. Also bounds how many objects a file can ask for."""

_SAVE_PLAIN = TRUST_REMEDY + ", or, if you wrote it yourself, save plain numpy columns (bool, int, float, object)"
_NUMPY_CORES = ("numpy.core", "numpy._core")
_INDEX_CLASSES = ("Index", "RangeIndex")
_OLD_INDEX_CLASSES = ("Int64Index", "UInt64Index", "Float64Index")

ALLOWED: dict[tuple[str, str], type[Recorded]] = {
    ("builtins", "slice"): Slice,
    ("__builtin__", "slice"): Slice,
    ("_codecs", "encode"): EncodedText,
    ("numpy", "ndarray"): Name,
    ("numpy", "dtype"): DataType,
    **{(f"{core}.multiarray", "_reconstruct"): ArrayShell for core in _NUMPY_CORES},
    **{(f"{core}.multiarray", "scalar"): Scalar for core in _NUMPY_CORES},
    **{(f"{core}.numeric", "_frombuffer"): ArrayFromBytes for core in _NUMPY_CORES},
    ("pandas", "DataFrame"): DataFrame,
    ("pandas.core.frame", "DataFrame"): DataFrame,
    ("pandas.core.internals", "BlockManager"): BlockManager,
    ("pandas.core.internals.managers", "BlockManager"): BlockManager,
    ("pandas.core.internals.blocks", "new_block"): Block,
    ("pandas._libs.internals", "_unpickle_block"): Block,
    ("pandas.core.indexes.base", "_new_Index"): Index,
    **{("pandas", name): Name for name in _INDEX_CLASSES},
    ("pandas.core.indexes.base", "Index"): Name,
    ("pandas.core.indexes.range", "RangeIndex"): Name,
    **{("pandas.core.indexes.numeric", name): Name for name in _OLD_INDEX_CLASSES},
    ("pandas._libs.arrays", "__pyx_unpickle_NDArrayBacked"): ExtensionArray,
    ("pandas.arrays", "StringArray"): Name,
    ("pandas.core.arrays.string_", "StringArray"): Name,
    ("pandas", "StringDtype"): Name,
    ("pandas.core.arrays.string_", "StringDtype"): Name,
}
"""Exact (module, name) pairs that a file may ask for, and the record that stands for each."""


def read_pickle(path: str | Path) -> dict[str, ndarray]:
    """Read the columns of a pickled pandas DataFrame (``.pkl`` or ``.pkl.gz``) by name; row labels are left out.

    Columns are (n,) arrays of bool, int, float, or object (str, numbers, None).

    Raises UntrustedDataError where the file asks for a name that is not in `ALLOWED`, DataError where it is missing,
    damaged, larger than `MAX_DECOMPRESSED_BYTES`, or holds something else than such a table.
    """
    path = Path(path)
    content = _read_content(path)
    try:
        return extract_columns(RecordingUnpickler(path, content, ALLOWED, "table", _SAVE_PLAIN).load())
    except UntrustedDataError:
        raise
    except Exception as error:  # a damaged pickle may raise anything at all
        raise DataError(path, f"holds no readable table ({type(error).__name__}: {error})", TRUST_REMEDY) from error


def _read_content(path: Path) -> bytes:
    """Read the unpacked bytes of a file, which may be gzipped."""
    try:
        require_plain_file(path)
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            content = file.read(MAX_DECOMPRESSED_BYTES + 1)
    except FileNotFoundError as error:
        raise DataError(path, "does not exist", "Check the clip's folder") from error
    except (OSError, EOFError, zlib.error) as error:
        raise DataError(path, f"cannot be unpacked ({error})", TRUST_REMEDY) from error
    if len(content) > MAX_DECOMPRESSED_BYTES:
        limit = MAX_DECOMPRESSED_BYTES // 2**20
        raise DataError(path, f"unpacks to more than {limit} MB", "No file of a clip is that large; " + TRUST_REMEDY)
    return content
