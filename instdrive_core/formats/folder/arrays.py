"""The arrays of a scene folder: one safetensors file, named by its content."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from safetensors import safe_open
from safetensors.numpy import load_file

from instdrive_core.formats.allocation import WHOLE, ReadOptions, check_memory
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians

BLOCK_ROWS = 65536
"""Rows read at a time where only some are kept."""
IDS = ("instance_ids", "codewords", "nodes")
EXTRA = "extra."
"""Names of columns that the program does not know begin so."""


def digest_arrays(arrays: dict[str, ndarray]) -> str:
    """Digest all arrays for the file's name: 16 hexadecimal digits of their SHA-256."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(_encode_title(name, array.dtype, array.shape))
        digest.update(array.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()[:16]


def read_arrays(path: Path, scene: Path, options: ReadOptions = WHOLE) -> tuple[dict[str, ndarray], str]:
    """Read the arrays in the file `path` of the folder `scene`, and the digest of all that the file holds.

    Arrays with a row per splat are reduced to the rows that are kept.

    Raises SceneTooLargeError before anything is loaded, SafetensorError or OSError where the file is damaged.
    """
    with safe_open(path, framework="numpy") as file:
        parts = {name: file.get_slice(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
        shapes = {name: tuple(part.get_shape()) for name, part in parts.items()}
        count = shapes.get("means", (0,))[0]
        rows = [name for name in shapes if count and _is_per_splat(name) and shapes[name][:1] == (count,)]
        sizes = [int(np.prod(shapes[name][1:])) * _count_value_bytes(name, parts[name]) for name in rows]
        check_memory(scene, count, sum(sizes), options)
        if options.keep_every == 1:
            arrays = load_file(path)
            return arrays, digest_arrays(arrays)
        arrays, digest = {}, hashlib.sha256()
        for number, name in enumerate(sorted(parts)):
            report(number / len(parts))
            if name not in rows:
                arrays[name] = file.get_tensor(name)
                digest.update(_encode_title(name, arrays[name].dtype, shapes[name]))
                digest.update(arrays[name].reshape(-1).view(np.uint8).data)
                continue
            dtype = parts[name][0:1].dtype
            digest.update(_encode_title(name, dtype, shapes[name]))
            arrays[name] = np.empty((options.count_kept(count), *shapes[name][1:]), dtype)
            for block, start in _read_blocks(parts[name], count):
                digest.update(np.ascontiguousarray(block).reshape(-1).view(np.uint8).data)
                source, target = options.locate_rows(start, start + len(block))
                arrays[name][target] = block[source]
        return arrays, digest.hexdigest()[:16]


def _is_per_splat(name: str) -> bool:
    return name in Gaussians.__dataclass_fields__ or name in IDS or name.startswith(EXTRA)


def _count_value_bytes(name: str, part: Any) -> int:
    """Count the bytes of one number in memory; float16 is opened as float32."""
    stored = int(part.get_dtype()[1:]) // 8 if part.get_dtype()[1:].isdecimal() else 4
    return max(stored, 4) if name in Gaussians.__dataclass_fields__ else stored


def _read_blocks(part: Any, count: int) -> Iterable[tuple[ndarray, int]]:
    return ((part[start : min(start + BLOCK_ROWS, count)], start) for start in range(0, count, BLOCK_ROWS))


def _encode_title(name: str, dtype: np.dtype, shape: tuple[int, ...]) -> bytes:
    return f"{name} {dtype.str} {shape}\n".encode()
