"""Reads torch checkpoints without torch and without running anything they ask for.

``torch.save`` writes a zip archive of members that are stored, not deflated: ``NAME/data.pkl``, a pickle of the object,
and ``NAME/data/KEY``, the numbers of each storage, which the pickle names by persistent ID. The pickle becomes records
(`recording_unpickler`); the numbers stay in the file until they are asked for (`stored_tensor`). Layout as in
``torch/serialization.py`` and ``torch/_utils.py`` of torch 1.6 to 2.9.
"""

from __future__ import annotations

import struct
import zipfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.files.pickled_table import DataType, EncodedText, Name, Recorded, Scalar
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.files.recording_unpickler import TRUST_REMEDY, RecordingUnpickler
from instdrive_core.files.stored_tensor import DAMAGE_REMEDY, Storage, StoredTensor, view_storage

MAX_MEMBERS = 100_000
MAX_PICKLE_BYTES = 64 << 20
"""Limit for the pickle; that of a scene with 2,000 tensors has 0.3 MB. Also bounds how many objects it can ask for."""
_PICKLE = "data.pkl"
_LOCAL_HEADER = struct.Struct("<4s22xHH")
_OLD_MAGIC = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."
_SAVE_PLAIN = f"{TRUST_REMEDY}; of your own model save `model.state_dict()`, not the model itself"
_SAVE_AGAIN = "If you trust it, load it with torch and write it again: torch.save(torch.load(old), new)"
_BAD_ZIP = (zipfile.BadZipFile, EOFError, OSError, ValueError, RuntimeError, NotImplementedError, struct.error)


class _Kept(Recorded):
    """An object of Python or torch that no scene needs, such as a device."""


class _OrderedItems(Recorded):
    """``OrderedDict`` or ``defaultdict``: its items are set one by one."""

    __slots__ = ("items",)
    items: dict[Any, Any]

    def __new__(cls, *args: Any) -> Recorded:
        record = super().__new__(cls, *args)
        assert isinstance(record, _OrderedItems)
        record.items = {}
        return record

    def __setitem__(self, key: Any, value: Any) -> None:
        self.items[key] = value


class _Tensor(Recorded):
    """``_rebuild_tensor_v2(storage, offset, shape, strides, …)``."""


class _Parameter(Recorded):
    """``_rebuild_parameter(tensor, …)``."""


class _TypedTensor(Recorded):
    """``_rebuild_from_type_v2(function, type, arguments, state)``: a tensor with attributes."""


class _StorageKind(Recorded):
    """The type of a storage's numbers."""

    dtype: ClassVar[str] = ""


def _name_storage(name: str, code: str) -> type[_StorageKind]:
    return type(name, (_StorageKind,), {"__slots__": (), "dtype": code})


_STORAGES = {
    "DoubleStorage": "f8",
    "FloatStorage": "f4",
    "HalfStorage": "f2",
    "BFloat16Storage": "u2",
    "BoolStorage": "b1",
    "LongStorage": "i8",
    "IntStorage": "i4",
    "ShortStorage": "i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
}
_DTYPES = ("float64", "float32", "float16", "bfloat16", "int64", "int32", "int16", "int8", "uint8", "bool")
_NUMPY_CORES = ("numpy.core", "numpy._core")

ALLOWED: Mapping[tuple[str, str], type[Recorded]] = {
    ("collections", "OrderedDict"): _OrderedItems,
    ("collections", "defaultdict"): _OrderedItems,
    ("torch._utils", "_rebuild_tensor"): _Tensor,
    ("torch._utils", "_rebuild_tensor_v2"): _Tensor,
    ("torch._utils", "_rebuild_parameter"): _Parameter,
    ("torch._utils", "_rebuild_parameter_with_state"): _Parameter,
    ("torch._tensor", "_rebuild_from_type_v2"): _TypedTensor,
    **{("torch", name): _name_storage(name, code) for name, code in _STORAGES.items()},
    **{("torch", name): Name for name in _DTYPES},
    **{("torch", name): _Kept for name in ("Size", "device")},
    **{("torch", name): Name for name in ("Tensor",)},
    ("torch.nn.parameter", "Parameter"): Name,
    **{("builtins", name): Name for name in ("dict", "list", "int", "float", "set")},
    ("argparse", "Namespace"): _Kept,
    **{(module, "PosixPath"): _Kept for module in ("pathlib", "pathlib._local")},
    **{(module, "WindowsPath"): _Kept for module in ("pathlib", "pathlib._local")},
    ("_codecs", "encode"): EncodedText,
    ("numpy", "dtype"): DataType,
    ("numpy", "ndarray"): Name,
    **{(f"{core}.multiarray", "scalar"): Scalar for core in _NUMPY_CORES},
    **{(f"{core}.multiarray", "_reconstruct"): _Kept for core in _NUMPY_CORES},
}
"""Exact (module, name) pairs that a checkpoint may ask for, and the record that stands for each."""


@dataclass(frozen=True)
class TorchCheckpoint:
    """What a file holds: dicts, lists, tuples, numbers, text, and records to be looked at through the methods."""

    path: Path
    content: Any

    def find_items(self, value: Any) -> dict[Any, Any] | None:
        """The items of a dict of any kind; None where it is none."""
        if isinstance(value, _OrderedItems):
            return value.items
        return value if isinstance(value, dict) else None

    def find_tensor(self, value: Any) -> StoredTensor | None:
        """The tensor that a value stands for; None where it is none. Raises DataError where it cannot be right."""
        if isinstance(value, _Parameter):
            value = value.args[0] if value.args else None
        if isinstance(value, _TypedTensor) and len(value.args) > 2 and value.args[0] is _Tensor:
            arguments = value.args[2]
            value = _Tensor(*arguments) if isinstance(arguments, tuple) else None
        if not isinstance(value, _Tensor):
            return None
        if len(value.args) < 4 or not isinstance(value.args[0], Storage):
            raise DataError(self.path, "a tensor names no numbers", TRUST_REMEDY)
        try:
            return view_storage(*value.args[:4])
        except ValueError as error:
            raise DataError(self.path, str(error), DAMAGE_REMEDY) from error


def open_torch_checkpoint(path: Path) -> TorchCheckpoint:
    """Open what ``torch.save`` has written, of torch 1.6 or later.

    Raises UntrustedDataError where it asks for a name that is not in `ALLOWED`, DataError where it is missing, damaged,
    of another format, or larger than its own counts.
    """
    try:
        require_plain_file(path)
        with path.open("rb") as file:
            beginning = file.read(512)
    except OSError as error:
        raise DataError(path, f"the file cannot be read ({error.strerror or error})", "Check the path") from error
    if not beginning.startswith(b"PK\x03\x04"):
        raise _explain_other_format(path, beginning)
    try:
        with zipfile.ZipFile(path) as archive:
            members = _check_members(path, archive.infolist())
            name = _find_pickle(path, members)
            with archive.open(name) as member:
                content = member.read(MAX_PICKLE_BYTES + 1)
            order_name = f"{name.removesuffix(_PICKLE)}byteorder"
            order = "<"
            if order_name in members:
                with archive.open(order_name) as member:
                    order = ">" if member.read(8) == b"big" else "<"
    except _BAD_ZIP as error:
        raise DataError(path, f"the checkpoint is no whole zip archive ({error})", DAMAGE_REMEDY) from error
    if len(content) > MAX_PICKLE_BYTES:
        problem = f"the pickle in it has more than {MAX_PICKLE_BYTES >> 20} MB"
        raise DataError(path, problem, "Save the tensors of the scene only")
    folder = name.removesuffix(_PICKLE)
    storages = {
        member.removeprefix(f"{folder}data/"): info
        for member, info in members.items()
        if member.startswith(f"{folder}data/")
    }
    try:
        return TorchCheckpoint(path, _TorchUnpickler(path, content, storages, order).load())
    except DataError:
        raise
    except Exception as error:  # a damaged pickle may raise anything at all
        problem = f"holds no readable checkpoint ({type(error).__name__}: {str(error)[:300]})"
        raise DataError(path, problem, TRUST_REMEDY) from error


def _explain_other_format(path: Path, beginning: bytes) -> DataError:
    if beginning.startswith(_OLD_MAGIC) or b"ustar" in beginning[257:265]:
        return DataError(path, "it is in the format of torch before 1.6, which is no zip archive", _SAVE_AGAIN)
    if beginning[:1] == b"\x80":
        return DataError(path, "it is a pickle, not what torch.save writes", _SAVE_AGAIN)
    return DataError(path, "it is no zip archive, so no checkpoint of torch", "Check that the file is whole")


def _check_members(path: Path, members: list[zipfile.ZipInfo]) -> dict[str, zipfile.ZipInfo]:
    if len(members) > MAX_MEMBERS:
        raise DataError(path, f"the archive has more than {MAX_MEMBERS:,} members", TRUST_REMEDY)
    twice = [name for name, count in Counter(info.filename for info in members).items() if count > 1]
    if twice:
        raise UntrustedDataError(path, f"the archive holds {twice[0][:200]!r} twice", TRUST_REMEDY)
    for info in members:
        if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size:
            problem = f"{info.filename[:200]!r} is compressed, which torch never does"
            raise DataError(path, problem, "Unpack nothing and pack nothing again: take the file as torch wrote it")
    return {info.filename: info for info in members}


def _find_pickle(path: Path, members: Mapping[str, zipfile.ZipInfo]) -> str:
    found = [name for name in members if name.rpartition("/")[2] == _PICKLE and name.count("/") < 2]
    if len(found) != 1:
        problem = f"the archive holds {len(found)} files called {_PICKLE}, not one, so torch.save has not written it"
        raise DataError(path, problem, "Check what kind of file it is")
    if any(name.startswith(f"{found[0].removesuffix(_PICKLE)}code/") for name in members):
        raise DataError(path, "it is a TorchScript program, not a checkpoint", _SAVE_PLAIN)
    return found[0]


class _TorchUnpickler(RecordingUnpickler):
    """Finds storages in the archive."""

    def __init__(self, path: Path, content: bytes, members: Mapping[str, zipfile.ZipInfo], order: str) -> None:
        super().__init__(path, content, ALLOWED, "checkpoint of a scene", _SAVE_PLAIN)
        self._members, self._order, self._found = members, order, dict[tuple[str, str], Storage]()

    def persistent_load(self, pid: Any) -> Storage:
        if not (isinstance(pid, tuple) and len(pid) >= 5 and pid[0] == "storage"):
            raise UntrustedDataError(self._path, "asks for an object outside of it; nothing was run", TRUST_REMEDY)
        _, kind, key, _, count = pid[:5]
        if not (isinstance(kind, type) and issubclass(kind, _StorageKind) and type(key) is str and type(count) is int):
            raise ValueError("the numbers of a tensor are named by something else than their type, key and count")
        info = self._members.get(key)
        if info is None:
            raise DataError(self._path, f"the numbers {key[:200]!r} of a tensor are missing", DAMAGE_REMEDY)
        dtype = np.dtype(self._order + kind.dtype)
        if count < 0 or count * dtype.itemsize != info.file_size:
            problem = f"the numbers {key[:200]!r} take {info.file_size} bytes, {count} of {dtype.itemsize} are promised"
            raise DataError(self._path, problem, DAMAGE_REMEDY)
        if (key, kind.__name__) not in self._found:
            offset = self._find_data(info)
            self._found[key, kind.__name__] = Storage(
                self._path, key, offset, count, dtype, kind.__name__ == "BFloat16Storage", info.CRC
            )
        return self._found[key, kind.__name__]

    def _find_data(self, info: zipfile.ZipInfo) -> int:
        """Bytes before a member's content; its own header may be padded so that numbers are aligned."""
        with self._path.open("rb") as file:
            file.seek(info.header_offset)
            header = file.read(_LOCAL_HEADER.size)
        if len(header) < _LOCAL_HEADER.size or header[:4] != b"PK\x03\x04":
            raise DataError(self._path, f"the member {info.filename[:200]!r} is not where it should be", DAMAGE_REMEDY)
        _, name, extra = _LOCAL_HEADER.unpack(header)
        offset = info.header_offset + _LOCAL_HEADER.size + name + extra
        if offset + info.file_size > self._path.stat().st_size:
            raise DataError(self._path, f"the file ends within {info.filename[:200]!r}", DAMAGE_REMEDY)
        return offset
