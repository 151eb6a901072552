"""Tensors that lie in a file as plain numbers, mapped into memory a window at a time."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy import ndarray

from instdrive_core.errors import DataError

_CHUNK = 1 << 20
DAMAGE_REMEDY = "The file was cut off or damaged on its way; copy it again"


@dataclass(frozen=True)
class Storage:
    """Numbers of one type that lie in a file one after the other."""

    path: Path
    name: str
    """For messages."""
    offset: int
    """Bytes before them."""
    count: int
    dtype: np.dtype
    """bfloat16 is `uint16` here: NumPy has no such type."""
    is_bfloat: bool
    checksum: int
    """CRC-32 of their bytes."""

    @cached_property
    def is_whole(self) -> bool:
        """Whether the bytes have their checksum; they are read once."""
        found, left = 0, self.count * self.dtype.itemsize
        with self.path.open("rb") as file:
            file.seek(self.offset)
            while left and (part := file.read(min(left, _CHUNK))):
                found = zlib.crc32(part, found)
                left -= len(part)
        return not left and found == self.checksum


@dataclass(frozen=True)
class StoredTensor:
    """An array in a storage. Nothing of it is in memory before `read`."""

    storage: Storage
    offset: int
    """Numbers of the storage before the first one."""
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    """Numbers from one entry of an axis to the next."""

    def read(self, start: int = 0, stop: int | None = None) -> ndarray:
        """Read rows `start` to `stop` as a copy; floats narrower than 32 bits become float32.

        Raises DataError where the bytes do not have their checksum.
        """
        storage = self.storage
        if not storage.is_whole:
            problem = f"the numbers of {storage.name!r} do not have their checksum"
            raise DataError(storage.path, problem, DAMAGE_REMEDY)
        rows = range(*slice(start, stop).indices(self.shape[0])) if self.shape else range(1)
        shape = (len(rows), *self.shape[1:]) if self.shape else ()
        if not math.prod(shape):
            return self._convert(np.empty(shape, storage.dtype))
        first = self.offset + (rows.start * self.strides[0] if self.shape else 0)
        span = 1 + sum((size - 1) * stride for size, stride in zip(shape, self.strides, strict=True))
        place = storage.offset + first * storage.dtype.itemsize
        window = np.memmap(storage.path, storage.dtype, "r", place, (span,))
        steps = [stride * storage.dtype.itemsize for stride in self.strides]
        return self._convert(np.lib.stride_tricks.as_strided(window, shape, steps, writeable=False))

    def _convert(self, values: ndarray) -> ndarray:
        if self.storage.is_bfloat:
            return (values.astype(np.uint32) << 16).view(np.float32)
        kind = values.dtype
        native = np.float32 if kind.kind == "f" and kind.itemsize < 4 else kind.newbyteorder("=")
        return np.array(values, native)


def view_storage(storage: Storage, offset: object, shape: object, strides: object) -> StoredTensor:
    """View a storage as an array. Raises ValueError where the array would not lie in it, or repeat its numbers."""
    sizes, steps = _expect_counts(shape), _expect_counts(strides)
    if type(offset) is not int or offset < 0 or len(sizes) != len(steps):
        raise ValueError(f"a tensor of {len(sizes)} axes has {len(steps)} strides, or begins before its numbers")
    count = math.prod(sizes)
    last = offset + sum((size - 1) * step for size, step in zip(sizes, steps, strict=True)) if count else 0
    if (count and last >= storage.count) or count > storage.count:
        raise ValueError(f"a tensor of shape {sizes} does not fit into the {storage.count} numbers of {storage.name!r}")
    return StoredTensor(storage, offset, sizes, steps)


def _expect_counts(values: object) -> tuple[int, ...]:
    if not isinstance(values, tuple) or len(values) > 8:
        raise ValueError("the shape of a tensor is no tuple of up to 8 numbers")
    if not all(type(value) is int and 0 <= value < 1 << 48 for value in values):
        raise ValueError("the shape of a tensor holds something else than counts")
    return values
