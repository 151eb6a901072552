"""Damage inside of zip, gzip, ZSTD, safetensors, JSON and pickles, checksums and lengths made right again; bombs."""

from __future__ import annotations

import copy
import gzip
import io
import json
import random
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import zstandard

from benchmarks.fuzz_mutations import BYTES, INTEGERS, PLY, Damage
from benchmarks.fuzz_pickles import hostile_pickles

BOMB = 1 << 29
"""Bytes to which bombs unfold."""
_PICKLES = hostile_pickles()
_ESCAPES = (
    "../outside/canary",
    "/etc/hostname",
    "..\\outside",
    "a/../../b",
    "C:\\x",
    "//host/x",
    ".",
    "",
    "a" * 5000,
    "a\0b",
)
_VALUES: tuple[Any, ...] = (
    *(None, True, [], {}, "", "x", 0, -1, 1, 0.5, 1e308, *INTEGERS, 10**40, float("nan"), float("inf"), -float("inf")),
    *([[]], [None] * 3, {"a": 1}, "9" * 5000, "\ud800", [0] * 20_000, *_ESCAPES),
)
_SPZ4_HEADER, _SPZ4_ENTRY = struct.Struct("<4sIIBBBBI12x"), struct.Struct("<QQ")


_DAMAGED_BEFORE = (
    *(ValueError, LookupError, OSError, EOFError, RuntimeError, struct.error),
    *(zlib.error, zstandard.ZstdError, zipfile.BadZipFile),
)
"""What taking a container apart raises that is damaged already."""


def inside(data: bytes, rng: random.Random, depth: int = 0) -> Damage:
    """Damage to what the file holds, whatever it is; damage to its bytes where it is no container."""
    for is_meant, damage in _KINDS:
        if is_meant(data) and depth < 3:
            try:
                return damage(data, rng, depth)
            except _DAMAGED_BEFORE:
                break
    return rng.choice(PLY if data[:3] == b"ply" else BYTES)(data, rng)


def _in_zip(data: bytes, rng: random.Random, depth: int) -> Damage:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(info.filename, archive.read(info)) for info in archive.infolist() if info.file_size < 1 << 22]
    row = rng.randrange(len(members))
    name, content = members[row]
    match rng.randrange(8):
        case 0:
            members.append((name, content[: rng.randrange(len(content) + 1)]))
            what = f"{name} stands twice"
        case 1:
            members[row] = (rng.choice(_ESCAPES), content)
            what = f"{name} was renamed"
        case 2:
            del members[row]
            what = f"{name} is missing"
        case 3:
            return Damage(_zip_bomb(members, row), f"{name} is a bomb")
        case 4:
            members += [(f"more{number}", b"") for number in range(rng.choice((1, 200, 2000)))]
            what = "more members"
        case 5:
            return _flip_members(data, rng)
        case _:
            damage = inside(content, rng, depth + 1)
            members[row] = (name, damage.data)
            what = f"{name}: {damage.what}"
    file = io.BytesIO()
    method = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))
    with zipfile.ZipFile(file, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that stand twice
        for name, content in members:
            if name:
                archive.writestr(zipfile.ZipInfo(name), content, method)
    return Damage(file.getvalue(), what)


def _zip_bomb(members: list[tuple[str, bytes]], row: int) -> bytes:
    """One member of zeros, a thousandth of what it unfolds to."""
    file = io.BytesIO()
    packed, checksum = _deflate_zeros()
    with zipfile.ZipFile(file, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that stand twice
        for number, (name, content) in enumerate(members):
            info = zipfile.ZipInfo(name)
            archive.writestr(info, packed if number == row else content)
            if number == row:  # what the directory at the end says is believed
                info.compress_type, info.file_size, info.CRC = zipfile.ZIP_DEFLATED, BOMB, checksum
    return file.getvalue()


@cache
def _deflate_zeros() -> tuple[bytes, int]:
    """Zeros deflated without a header, and their CRC-32."""
    packer, checksum, parts = zlib.compressobj(1, zlib.DEFLATED, -15), 0, []
    for _ in range(BOMB // len(_ZEROS)):
        parts.append(packer.compress(_ZEROS))
        checksum = zlib.crc32(_ZEROS, checksum)
    return b"".join((*parts, packer.flush())), checksum


_ZEROS = bytes(1 << 24)


def _flip_members(data: bytes, rng: random.Random) -> Damage:
    """A bit of a member's content is wrong, which its checksum shows."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        info = rng.choice([info for info in archive.infolist() if info.compress_size])
    start = info.header_offset + 30 + sum(struct.unpack_from("<HH", data, info.header_offset + 26))
    changed = bytearray(data)
    changed[start + rng.randrange(info.compress_size)] ^= 1 << rng.randrange(8)
    return Damage(bytes(changed), f"a bit of {info.filename} flipped", True)


def _in_gzip(data: bytes, rng: random.Random, depth: int) -> Damage:
    match rng.randrange(6):
        case 0:
            changed = bytearray(data)
            changed[rng.randrange(10, len(data))] ^= 1 << rng.randrange(8)
            return Damage(bytes(changed), "a bit of the gzip stream flipped", True)
        case 1:
            return Damage(_gzip_bomb(), "a gzip bomb")
        case 2:
            return Damage(data + data, "gzip members joined")
        case _:
            pass
    damage = inside(gzip.decompress(data), rng, depth + 1)
    return Damage(gzip.compress(damage.data, 1, mtime=0), f"inside gzip: {damage.what}", damage.must_show)


def _gzip_bomb() -> bytes:
    packed, checksum = _deflate_zeros()
    return gzip.compress(b"", mtime=0)[:10] + packed + struct.pack("<II", checksum, BOMB)


def _in_spz4(data: bytes, rng: random.Random, depth: int) -> Damage:
    magic, *fields, streams, toc = _SPZ4_HEADER.unpack_from(data)
    entries = [list(_SPZ4_ENTRY.unpack_from(data, toc + number * _SPZ4_ENTRY.size)) for number in range(streams)]
    start = toc + streams * _SPZ4_ENTRY.size
    match rng.randrange(5):
        case 0:
            changed = bytearray(data)
            changed[rng.randrange(start, len(data))] ^= 1 << rng.randrange(8)
            return Damage(bytes(changed), "a bit of a ZSTD stream flipped", True)
        case 1:
            fields[1] = rng.choice((fields[1] - 1, fields[1] + 1, *INTEGERS)) % 2**32
            return Damage(
                _SPZ4_HEADER.pack(magic, *fields, streams, toc) + data[_SPZ4_HEADER.size :], "another count", True
            )
        case 2:
            fields = [
                rng.choice((field, field + 1, 255)) % 256 if row != 1 else field for row, field in enumerate(fields)
            ]
            return Damage(_SPZ4_HEADER.pack(magic, *fields, streams, toc) + data[_SPZ4_HEADER.size :], "header fields")
        case _:
            pass
    parts = []
    for packed, _ in entries:
        parts.append(data[start : start + packed])
        start += packed
    row = rng.randrange(streams)
    content = zstandard.ZstdDecompressor().decompress(parts[row], max_output_size=1 << 24)
    if rng.random() < 0.15:
        parts[row] = _zstd_bomb(rng.random() < 0.5)
    else:
        content = rng.choice(BYTES)(content, rng).data
        parts[row] = zstandard.ZstdCompressor(write_checksum=True).compress(content)
        entries[row][1] = rng.choice((entries[row][1], len(content)))
    entries[row][0] = len(parts[row])
    toc_bytes = b"".join(_SPZ4_ENTRY.pack(*entry) for entry in entries)
    return Damage(data[:toc] + toc_bytes + b"".join(parts), f"inside of stream {row}")


@cache
def _zstd_bomb(says_size: bool) -> bytes:
    compressor = zstandard.ZstdCompressor(level=1, write_content_size=says_size)
    packer = compressor.compressobj(size=BOMB) if says_size else compressor.compressobj()
    return b"".join(packer.compress(_ZEROS) for _ in range(BOMB // len(_ZEROS))) + packer.flush()


def _in_safetensors(data: bytes, rng: random.Random, depth: int) -> Damage:
    length = struct.unpack_from("<Q", data)[0]
    header, body = json.loads(data[8 : 8 + length]), data[8 + length :]
    if rng.random() < 0.4:
        changed = bytearray(body)
        changed[rng.randrange(len(body))] ^= 1 << rng.randrange(8)
        return Damage(data[: 8 + length] + bytes(changed), "a bit of the arrays flipped", True)
    text = json.dumps(_change_json(header, rng)).encode(errors="replace")
    return Damage(struct.pack("<Q", len(text)) + text + body, "the arrays' header")


def _in_json(data: bytes, rng: random.Random, depth: int) -> Damage:
    if rng.random() < 0.15:
        deep = rng.choice(
            (b"[" * 100_000, b'{"a":' * 50_000, b"[" * 900 + b"]" * 900, b'{"a":' * 400 + b"1" + b"}" * 400)
        )
        place = data.find(b":", rng.randrange(len(data)))
        return Damage(
            deep if place < 0 or rng.random() < 0.5 else data[: place + 1] + deep + data[place + 1 :], "nested"
        )
    changed = _change_json(json.loads(data), rng)
    return Damage(json.dumps(changed).encode(errors="replace"), "a value of the JSON")


def _in_lines(data: bytes, rng: random.Random, depth: int) -> Damage:
    """Lines of JSON, with or without a checksum before each."""
    rows = data.splitlines()
    row = rng.randrange(len(rows))
    text = rows[row]
    has_sum = text[8:9] == b" " and text[:1] != b"{"
    value = _change_json(json.loads(text[9:] if has_sum else text), rng)
    text = json.dumps(value).encode(errors="replace")
    rows[row] = b"%08x %s" % (zlib.crc32(text), text) if has_sum else text
    return Damage(b"\n".join(rows) + b"\n", f"line {row} of JSON")


def _change_json(value: Any, rng: random.Random) -> Any:
    """One place of it is something else, missing, or another place's."""
    value = copy.deepcopy(value)
    places = list(_places(value))
    if not places:
        return rng.choice(_VALUES)
    for _ in range(rng.choice((1, 1, 2))):
        holder, key = rng.choice(places)
        match rng.randrange(6):
            case 0 if isinstance(holder, dict):
                holder.pop(key, None)
            case 1:
                other, other_key = rng.choice(places)
                holder[key] = copy.deepcopy(other[other_key]) if _has(other, other_key) else None
            case 2 if _has(holder, key) and isinstance(holder[key], int | float):
                holder[key] = holder[key] * rng.choice((-1, 0, 2, 1e9)) + rng.choice((0, 1, -1))
            case 3 if _has(holder, key) and isinstance(holder[key], str):
                holder[key] = rng.choice(
                    (f"../{holder[key]}", f"../outside/{holder[key]}", f"/{holder[key]}", holder[key][1:])
                )
            case 4 if isinstance(holder, list):
                holder += holder[: rng.choice((1, 1000))]
            case _:
                holder[key] = rng.choice(_VALUES)
    return value


def _has(holder: Any, key: Any) -> bool:
    return key in holder if isinstance(holder, dict) else isinstance(key, int) and key < len(holder)


def _places(value: Any, depth: int = 0) -> Iterator[tuple[Any, Any]]:
    if depth > 12 or not isinstance(value, dict | list):
        return
    keys = list(value) if isinstance(value, dict) else range(min(len(value), 40))
    for key in keys:
        yield value, key
        yield from _places(value[key], depth + 1)


def _in_pickle(data: bytes, rng: random.Random, depth: int) -> Damage:
    name = rng.choice(list(_PICKLES))
    if rng.random() < 0.5:
        return Damage(_PICKLES[name], f"pickle: {name}")
    place = rng.randrange(2, len(data))
    code = _PICKLES[name].removesuffix(b".")
    code = code[2:] if code[:1] == b"\x80" else code
    return Damage(data[:place] + code + data[place:], f"pickle within: {name}")


def _is_lines(data: bytes) -> bool:
    return data.count(b"\n") > 0 and (data[8:10] == b" {" or data[:1] == b"{") and b"}\n" in data[:200_000]


_KINDS: tuple[tuple[Callable[[bytes], bool], Callable[[bytes, random.Random, int], Damage]], ...] = (
    (lambda data: data[:4] == b"PK\x03\x04", _in_zip),
    (lambda data: data[:2] == b"\x1f\x8b", _in_gzip),
    (lambda data: data[:5] == b"NGSP\x04", _in_spz4),
    (lambda data: data[7:9] == b"\0{", _in_safetensors),
    (_is_lines, _in_lines),
    (lambda data: data[:1] in (b"{", b"["), _in_json),
    (lambda data: data[:1] == b"\x80" and data[1:2] < b"\x06", _in_pickle),
)
"""What a file is, by its first bytes, and what goes inside of it."""
