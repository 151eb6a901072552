"""Accessors of glTF: typed views of the bytes of a buffer, their ranges checked before anything is read."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.gltf.container import REMEDY, GltfFile

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
FLOAT, UNSIGNED_BYTE = 5126, 5121
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}


def count_accessor(gltf: GltfFile, index: Any) -> int:
    """Count the rows that an accessor says it has. Raises DataError."""
    return _whole(gltf, gltf.get_entry("accessors", index), "count", None)


def read_accessor(gltf: GltfFile, index: Any, width: int, count: int, name: str) -> Float32[ndarray, "n {width}"]:
    """Read an accessor as floats; normalised whole numbers become fractions, as glTF defines them.

    Args:
        gltf: the file.
        index: number of the accessor.
        width: values per row that there must be.
        count: rows that there must be.
        name: what the values are, for messages.

    Raises DataError where type, count or range are wrong, or the accessor is sparse.
    """
    entry = gltf.get_entry("accessors", index)
    kind = entry.get("componentType")
    if not isinstance(kind, int) or kind not in _KINDS or WIDTHS.get(str(entry.get("type"))) != width:
        problem = f"{name} has type {entry.get('type')!r} of components {kind!r}, which it cannot have"
        raise DataError(gltf.path, problem, REMEDY)
    if "sparse" in entry or "bufferView" not in entry:
        raise DataError(gltf.path, f"{name} is stored sparsely, which is not read", "Export it with plain accessors")
    if _whole(gltf, entry, "count", None) != count:
        raise DataError(gltf.path, f"{name} has {entry['count']} rows where positions have {count}", REMEDY)
    view = gltf.get_entry("bufferViews", entry["bufferView"])
    dtype = np.dtype(_KINDS[kind])
    row = dtype.itemsize * width
    stride = _whole(gltf, view, "byteStride", row)
    start, length = _whole(gltf, view, "byteOffset", 0), _whole(gltf, view, "byteLength", None)
    first = _whole(gltf, entry, "byteOffset", 0)
    buffer = gltf.get_buffer(view.get("buffer"))
    if start + length > len(buffer) or stride < row or (count and first + (count - 1) * stride + row > length):
        raise DataError(gltf.path, f"{name} reaches beyond the end of its buffer", REMEDY)
    data = buffer[start + first : start + first + ((count - 1) * stride + row if count else 0)]
    values = np.ndarray((count, width), dtype, np.ascontiguousarray(data), strides=(stride, dtype.itemsize))
    floats = values.astype(np.float32)
    if entry.get("normalized") is True and kind != FLOAT:
        floats = np.maximum(floats / np.float32(np.iinfo(dtype).max), np.float32(-1))
    return floats


def _whole(gltf: GltfFile, entry: dict[str, Any], key: str, default: int | None) -> int:
    value = entry.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 1 << 48:
        raise DataError(gltf.path, f"'{key}' is {str(value)[:80]}, not a whole number", REMEDY)
    return value
