"""The parts of a page that hold data: a .sog, the IDs of its splats, and what is known of the scene."""

from __future__ import annotations

import base64
import binascii
import json
import mmap
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.json_value import parse_json

SPLATS, IDS, ABOUT = "instdrive-splats", "instdrive-ids", "instdrive-about"
"""Ids of the elements: base64 of a .sog, base64 of zlib of uint32, and JSON."""
REMEDY = "Copy the page again, or export it again"
_END, _LAST = b"</script>", b"</html>"
_MAX_ABOUT_BYTES = 64 << 20


def build_element(name: str, content: bytes) -> bytes:
    """Build an element whose content no browser runs; `content` must have no ``<``."""
    return _start(name) + content + _END


def encode_ids(ids: UInt32[ndarray, " n"]) -> bytes:
    """Encode IDs as zlib of little-endian uint32, in base64."""
    return base64.b64encode(zlib.compress(ids.astype("<u4").tobytes(), 9))


def encode_about(about: dict[str, Any]) -> bytes:
    """Encode as JSON that ends no element, whatever the user's names hold."""
    return json.dumps(about, separators=(",", ":")).replace("<", "\\u003c").encode()


def read_elements(path: Path) -> dict[str, bytes]:
    """Read the content of the three elements of a page, undecoded. Raises DataError where one is missing."""
    if not path.stat().st_size:
        raise DataError(path, "the file is empty", REMEDY)
    found: dict[str, bytes] = {}
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as page:
        for name in (SPLATS, IDS, ABOUT):
            start = page.find(_start(name))
            end = page.find(_END, start) if start >= 0 else -1
            if end < 0:
                problem = f"the page holds no whole scene of this program: the element {name!r} is missing"
                raise DataError(path, problem, "Only pages exported by this program are opened; export it again")
            found[name] = page[start + len(_start(name)) : end]
        if page.rfind(_LAST) < 0:
            raise DataError(path, "the page has no end", REMEDY)
    return found


def decode_splats(content: bytes, path: Path) -> bytes:
    """Decode the bytes of the .sog. Raises DataError."""
    return _decode_base64(content, SPLATS, path)


def decode_ids(content: bytes, count: int, path: Path) -> UInt32[ndarray, " n"]:
    """Decode `count` IDs. Raises DataError where there are more or fewer."""
    data = _decode_base64(content, IDS, path)
    decompressor = zlib.decompressobj()
    try:
        ids = decompressor.decompress(data, 4 * count + 1)
    except zlib.error as error:
        raise DataError(path, f"the IDs of its splats are damaged ({error})", REMEDY) from error
    if len(ids) != 4 * count or not decompressor.eof:
        problem = f"the IDs of its splats have {len(ids)} bytes or more, {count} splats have {4 * count}"
        raise DataError(path, problem, REMEDY)
    return np.frombuffer(ids, "<u4").astype(np.uint32)


def decode_about(content: bytes, path: Path) -> dict[str, Any]:
    """Decode what is known of the scene. Raises DataError where it is no object."""
    try:
        if len(content) > _MAX_ABOUT_BYTES:
            raise ValueError(f"{len(content)} bytes are too many")
        about = parse_json(content)
    except (ValueError, RecursionError) as error:
        raise DataError(path, f"{ABOUT!r} is no JSON ({error})", REMEDY) from error
    if not isinstance(about, dict):
        raise DataError(path, f"{ABOUT!r} holds a {type(about).__name__}, not an object", REMEDY)
    return about


def _start(name: str) -> bytes:
    return f'<script type="text/plain" id="{name}">'.encode()


def _decode_base64(content: bytes, name: str, path: Path) -> bytes:
    try:
        return base64.b64decode(content, validate=True)
    except (binascii.Error, ValueError) as error:
        raise DataError(path, f"{name!r} is no base64 ({error})", REMEDY) from error
