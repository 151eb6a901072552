"""Reads tables out of pandas pickles without running anything they ask for.

A pickle is a program that may call whatever it can name, and PandaSet's files come from mirrors. Here each name on the
allow list stands for a record that only remembers its arguments; nothing of numpy or pandas is called while the
pickle is read, and every other name is refused. The columns are then taken out of the records
(`pickled_table.py`), so that files written by any version of pandas read the same.
"""

from __future__ import annotations

import gzip
import io
import pickle
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

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

MAX_DECOMPRESSED_BYTES = 64 * 2**20
"""Limit for one unpacked file; a PandaSet sweep unpacks to 8 MB. Also bounds how many objects a file can ask for."""

_REMEDY = "Get the file again from a source you trust"

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
        return extract_columns(_RecordingUnpickler(path, content).load())
    except UntrustedDataError:
        raise
    except Exception as error:  # a damaged pickle may raise anything at all
        raise DataError(path, f"holds no readable table ({type(error).__name__}: {error})", _REMEDY) from error


def _read_content(path: Path) -> bytes:
    """Read the unpacked bytes of a file, which may be gzipped."""
    try:
        require_plain_file(path)
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            content = file.read(MAX_DECOMPRESSED_BYTES + 1)
    except FileNotFoundError as error:
        raise DataError(path, "does not exist", "Check the clip's folder") from error
    except (OSError, EOFError, zlib.error) as error:
        raise DataError(path, f"cannot be unpacked ({error})", _REMEDY) from error
    if len(content) > MAX_DECOMPRESSED_BYTES:
        limit = MAX_DECOMPRESSED_BYTES // 2**20
        raise DataError(path, f"unpacks to more than {limit} MB", "No file of a clip is that large; " + _REMEDY)
    return content


def _check_keys(keys: list[Any]) -> None:
    """Refuse compound keys: C code hashes tuples in tuples without a limit of depth (the process dies) or time."""
    for key in keys:
        if key is not None and type(key) not in (str, bytes, int, float, bool):
            raise pickle.UnpicklingError(f"a {type(key).__name__} stands as a key")


_PLAIN: dict[int, Callable[[Any], None]] = dict(pickle._Unpickler.dispatch)  # pyright: ignore[reportPrivateUsage]
"""Actions of the opcodes in any pickle."""


class _RecordingUnpickler(pickle._Unpickler):  # pyright: ignore[reportPrivateUsage]
    """Gives records instead of functions and classes.

    The Python implementation on purpose: in the C one, a forged memo index allocates memory without a limit.
    """

    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = dict(_PLAIN)
    read: Callable[[int], bytes]
    append: Callable[[Any], None]
    stack: list[Any]

    def __init__(self, path: Path, content: bytes) -> None:
        super().__init__(io.BytesIO(content))
        self._path, self._size = path, len(content)

    def load_bytearray8(self) -> None:
        """Load bytes, after the length that the file claims is checked: the base class allocates it blindly."""
        (length,) = struct.unpack("<Q", self.read(8))
        if length > self._size:
            raise pickle.UnpicklingError(f"{length} bytes are announced in a file of {self._size}")
        self.append(bytearray(self.read(length)))

    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8

    def load_setitem(self) -> None:
        """Set an item after its keys are checked (`_check_keys`)."""
        _check_keys(self.stack[-2:-1])
        _PLAIN[pickle.SETITEM[0]](self)

    dispatch[pickle.SETITEM[0]] = load_setitem

    def load_setitems(self) -> None:
        """Set items after their keys are checked (`_check_keys`)."""
        _check_keys(self.stack[::2])
        _PLAIN[pickle.SETITEMS[0]](self)

    dispatch[pickle.SETITEMS[0]] = load_setitems

    def load_dict(self) -> None:
        """Build a dict after its keys are checked (`_check_keys`)."""
        _check_keys(self.stack[::2])
        _PLAIN[pickle.DICT[0]](self)

    dispatch[pickle.DICT[0]] = load_dict

    def load_set(self) -> None:
        """Refuse sets: no table holds one, and every element would be hashed."""
        raise pickle.UnpicklingError("a set stands where no table has one")

    dispatch[pickle.EMPTY_SET[0]] = dispatch[pickle.FROZENSET[0]] = dispatch[pickle.ADDITEMS[0]] = load_set

    def find_class(self, module: str, name: str) -> type[Recorded]:
        recorded = ALLOWED.get((module, name))
        if recorded is None:
            raise UntrustedDataError(
                self._path,
                f"asks for '{module}.{name}', which no table needs; nothing of it was run",
                _REMEDY + ", or, if you wrote it yourself, save plain numpy columns (bool, int, float, object)",
            )
        return recorded

    def get_extension(self, code: int) -> Any:
        raise UntrustedDataError(self._path, f"asks for the registered extension {code}; nothing was run", _REMEDY)

    def persistent_load(self, pid: Any) -> Any:
        raise UntrustedDataError(self._path, f"asks for the outside object {pid!r}; nothing was run", _REMEDY)
