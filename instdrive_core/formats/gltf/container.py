"""The JSON and the buffers of a .glb or .gltf, read without trusting them."""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.files.plain_file import require_plain_file

MAGIC = b"glTF"
HEADER = struct.Struct("<4sII")
CHUNK = struct.Struct("<II")
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
REMEDY = "Export it again, or copy it again with all its files"
_EMBEDDED = "data:"


@dataclass
class GltfFile:
    """The content of a file; buffers are mapped or decoded when they are first needed."""

    path: Path
    content: dict[str, Any]
    binary: UInt8[ndarray, " n"] | None
    """The binary chunk of a .glb."""
    size: int
    """Bytes of the file and of all buffers read so far."""
    _buffers: dict[int, UInt8[ndarray, " n"]] = field(default_factory=dict)

    def get_entries(self, name: str) -> list[dict[str, Any]]:
        """Return a list of objects at the top; empty where there is none. Raises DataError for anything else."""
        entries = self.content.get(name, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise DataError(self.path, f"'{name}' is no list of objects", REMEDY)
        return entries

    def get_entry(self, name: str, index: Any) -> dict[str, Any]:
        """Return one entry of a list at the top. Raises DataError where there is no such one."""
        entries = self.get_entries(name)
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(entries):
            raise DataError(self.path, f"{index!r} is none of its {len(entries)} '{name}'", REMEDY)
        return entries[index]

    def get_buffer(self, index: Any) -> UInt8[ndarray, " n"]:
        """Return the bytes of a buffer. Raises DataError where they are missing, UntrustedDataError for odd places."""
        entry = self.get_entry("buffers", index)
        if index not in self._buffers:
            uri = entry.get("uri")
            if uri is None:
                if index or self.binary is None:
                    raise DataError(self.path, f"buffer {index} has no data", REMEDY)
                self._buffers[index] = self.binary
            elif isinstance(uri, str) and uri.startswith(_EMBEDDED):
                self._buffers[index] = self._decode(index, uri)
            else:
                self._buffers[index] = self._map_file(uri)
        return self._buffers[index]

    def _decode(self, index: int, uri: str) -> UInt8[ndarray, " n"]:
        try:
            return np.frombuffer(base64.b64decode(uri[uri.index(";base64,") + 8 :], validate=True), np.uint8)
        except (ValueError, binascii.Error) as error:
            raise DataError(self.path, f"the data of buffer {index} is no base64 ({error})", REMEDY) from error

    def _map_file(self, uri: Any) -> UInt8[ndarray, " n"]:
        if not isinstance(uri, str) or not uri or any(sign in uri for sign in "/\\:%\0") or uri in (".", ".."):
            problem = f"the buffer {str(uri)[:200]!r} is no file beside the scene"
            raise UntrustedDataError(self.path, problem, "Put the buffer beside the scene, or export a .glb")
        file = self.path.parent / uri
        if not file.is_file():
            raise DataError(self.path, f"the file {uri!r} is missing", REMEDY)
        self.size += file.stat().st_size
        return _map_bytes(file)


def open_gltf(path: Path) -> GltfFile:
    """Open a .glb or .gltf, whichever its first bytes say. Raises DataError where it is neither, or damaged."""
    size = require_plain_file(path).stat().st_size
    with path.open("rb") as file:
        start = file.read(HEADER.size)
        if start[:4] != MAGIC:
            return GltfFile(path, _parse(path, start + file.read()), None, size)
        if len(start) < HEADER.size:
            raise DataError(path, "the file ends inside its header", REMEDY)
        _, version, length = HEADER.unpack(start)
        if version != 2:
            raise DataError(path, f"its version is {version}, not 2", "Export it as glTF 2.0")
        if length != size:
            raise DataError(path, f"it has {size} bytes, its header says {length}", REMEDY)
        content, binary, place = None, None, HEADER.size
        while place < size:
            head = file.read(CHUNK.size)
            kind, count = (0, 0) if len(head) < CHUNK.size else (CHUNK.unpack(head)[1], CHUNK.unpack(head)[0])
            place += CHUNK.size
            if len(head) < CHUNK.size or place + count > size:
                raise DataError(path, f"the chunk at byte {place - CHUNK.size} is cut off", REMEDY)
            if kind == JSON_CHUNK and content is None:
                content = _parse(path, file.read(count))
            elif kind == BINARY_CHUNK and binary is None:
                binary = _map_bytes(path)[place : place + count]
            place += count
            file.seek(place)
    if content is None:
        raise DataError(path, "it holds no JSON", REMEDY)
    return GltfFile(path, content, binary, size)


def _parse(path: Path, text: bytes) -> dict[str, Any]:
    try:
        content = parse_bounded_json(text.rstrip(b"\0 "))
    except (ValueError, RecursionError, json.JSONDecodeError) as error:
        raise DataError(path, f"its JSON cannot be read ({error})", REMEDY) from error
    if not isinstance(content, dict):
        raise DataError(path, f"its JSON is a {type(content).__name__}, not an object", REMEDY)
    return content


def _map_bytes(path: Path) -> UInt8[ndarray, " n"]:
    return np.memmap(path, np.uint8, "r") if path.stat().st_size else np.empty(0, np.uint8)
