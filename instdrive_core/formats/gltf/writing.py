"""Writing scenes as glTF: a node for each instance, whose extras say which it is; `scenes` says what values mean."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.formats.export_checks import check_numbers, check_static
from instdrive_core.formats.gltf.accessors import FLOAT, UNSIGNED_BYTE, WIDTHS
from instdrive_core.formats.gltf.container import BINARY_CHUNK, CHUNK, HEADER, JSON_CHUNK, MAGIC
from instdrive_core.formats.gltf.nodes import Z_UP_FROM_Y_UP
from instdrive_core.formats.gltf.scenes import COLOR_SPACE, EXTENSION, KERNEL, list_sh_names
from instdrive_core.formats.instance_parts import list_instance_parts, order_by_instance
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

BLOCK_ROWS = 16384
"""Rows converted at a time."""
_LARGEST = (1 << 32) - 1
_LOG_SCALE_LIMITS = (-87.0, 88.0)
_TYPES = {width: name for name, width in WIDTHS.items()}
Column = tuple[str, int, int, Callable[[Gaussians], ndarray]]
"""Attribute, values per row, type of its components, and its values of some Gaussians."""


def write_glb(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment as a .glb, atomically.

    Raises DataError where the scene has moving actors, no splats, values that are no numbers, or more than 4 GiB.
    """
    content, columns, order = _describe(path, scene)
    size = content["buffers"][0]["byteLength"]
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    length = HEADER.size + 2 * CHUNK.size + len(text) + size
    if length > _LARGEST:
        problem = f"the scene needs {length:,} bytes, a .glb holds {_LARGEST:,} at most"
        raise DataError(path, problem, "Save as .ply, or export parts of it")
    with open_atomically(path) as file:
        file.write(HEADER.pack(MAGIC, 2, length) + CHUNK.pack(len(text), JSON_CHUNK) + text)
        file.write(CHUNK.pack(size, BINARY_CHUNK))
        for block in _pack_columns(scene, columns, order):
            file.write(block)


def write_gltf(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment as a .gltf with its buffer inside, a third larger than a .glb, atomically.

    Raises DataError where `write_glb` does, but for the size.
    """
    content, columns, order = _describe(path, scene)
    mark = "BUFFER"
    content["buffers"][0]["uri"] = mark
    before, after = json.dumps(content, indent=1).split(f'"{mark}"')
    with open_atomically(path) as file:
        file.write(f'{before}"data:application/octet-stream;base64,'.encode())
        rest = b""
        for block in _pack_columns(scene, columns, order):
            whole = len(rest + block) // 3 * 3  # base64 writes three bytes as four letters
            file.write(base64.b64encode((rest + block)[:whole]))
            rest = (rest + block)[whole:]
        file.write(base64.b64encode(rest))
        file.write(f'"{after}'.encode())


def _describe(path: str | Path, scene: Scene) -> tuple[dict[str, Any], list[Column], Int64[ndarray, " n"]]:
    """Describe the file: the JSON, the columns of its buffer one after the other, and the order of their rows."""
    check_static(path, scene, Path(path).suffix)
    if not len(scene):
        raise DataError(path, "the scene has no splats, and an accessor needs a row", "Save as .ply instead")
    _check(path, scene.gaussians)
    columns, order = _list_columns(scene.gaussians.sh_degree), order_by_instance(scene)
    parts = list(list_instance_parts(scene))
    views, accessors, place = [], [], 0
    for _, width, kind, _ in columns:
        stride = width * (4 if kind == FLOAT else 1)
        views.append({"buffer": 0, "byteOffset": place, "byteLength": stride * len(scene), "target": 34962})
        if len(parts) > 1:
            views[-1]["byteStride"] = stride
        place += stride * len(scene)
    meshes, nodes = [], [{"name": "z up to y up", "matrix": Z_UP_FROM_Y_UP.ravel().tolist(), "children": []}]
    for number, part in enumerate(parts):
        attributes = {}
        for view, (name, width, kind, _) in enumerate(columns):
            attributes[name] = len(accessors)
            accessor: dict[str, Any] = {"bufferView": view, "componentType": kind, "type": _TYPES[width]}
            accessor["byteOffset"] = part.rows.start * width * (4 if kind == FLOAT else 1)
            accessor["count"] = part.rows.stop - part.rows.start
            if name == "POSITION":
                means = scene.gaussians.means[order[part.rows]]
                accessor |= {"min": means.min(axis=0).tolist(), "max": means.max(axis=0).tolist()}
            if kind == UNSIGNED_BYTE:
                accessor["normalized"] = True
            accessors.append(accessor)
        splatting = {"kernel": KERNEL, "colorSpace": COLOR_SPACE}
        splatting |= {"sortingMethod": "cameraDistance", "projection": "perspective"}
        primitive = {"attributes": attributes, "mode": 0, "extensions": {EXTENSION: splatting}}
        meshes.append({"name": part.name, "primitives": [primitive]})
        nodes.append({"name": part.name, "mesh": number, "extras": part.describe()})
        nodes[0]["children"].append(number + 1)
    about = {"origin": scene.origin.tolist(), "code_bits": scene.code_bits, "antialiased": scene.antialiased}
    content = {
        "asset": {"version": "2.0", "generator": "InstDrive", "extras": about},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": place}],
    }
    return content, columns, order


def _list_columns(degree: int) -> list[Column]:
    columns: list[Column] = [
        ("POSITION", 3, FLOAT, lambda part: part.means),
        (f"{EXTENSION}:ROTATION", 4, FLOAT, _get_rotations),
        (f"{EXTENSION}:SCALE", 3, FLOAT, _get_scales),
        (f"{EXTENSION}:OPACITY", 1, FLOAT, lambda part: sigmoid(part.opacity_logits.astype(np.float64))),
        (list_sh_names(0)[0], 3, FLOAT, lambda part: part.sh_dc),
        ("COLOR_0", 4, UNSIGNED_BYTE, _get_colors),
    ]
    names = [name for number in range(1, degree + 1) for name in list_sh_names(number)]
    for place, name in enumerate(names):
        columns.append((name, 3, FLOAT, lambda part, place=place: part.sh_rest[:, place]))
    return columns


def _get_rotations(part: Gaussians) -> ndarray:
    return normalize_quaternions(part.quats.astype(np.float64))[:, [1, 2, 3, 0]]


def _get_scales(part: Gaussians) -> ndarray:
    flat = np.isneginf(part.log_scales)
    return np.where(flat, 0, np.exp(np.clip(part.log_scales.astype(np.float64), *_LOG_SCALE_LIMITS)))


def _get_colors(part: Gaussians) -> ndarray:
    """Colour and opacity for programs that show points only; glTF wants the colour linear."""
    color = np.clip(color_from_dc(part.sh_dc.astype(np.float64)), 0, 1)
    linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    return np.rint(255 * np.c_[linear, sigmoid(part.opacity_logits.astype(np.float64))])


def _pack_columns(scene: Scene, columns: list[Column], order: Int64[ndarray, " n"]) -> Iterator[bytes]:
    for number, (_, _, kind, get) in enumerate(columns):
        dtype = "<f4" if kind == FLOAT else "u1"
        for rows in _list_blocks(order):
            yield np.ascontiguousarray(get(scene.gaussians.select(rows)), dtype).tobytes()
        report((number + 1) / len(columns))


def _list_blocks(order: Int64[ndarray, " n"]) -> Iterator[Int64[ndarray, " k"]]:
    for start in range(0, len(order), BLOCK_ROWS):
        yield order[start : start + BLOCK_ROWS]


def _check(path: str | Path, gaussians: Gaussians) -> None:
    rows = np.arange(len(gaussians))
    for name in ("means", "quats", "sh_dc", "sh_rest"):
        check_numbers(path, name, getattr(gaussians, name), rows)
    for name in ("log_scales", "opacity_logits"):
        check_numbers(path, name, getattr(gaussians, name), rows, allow_infinite=True)
