"""The containers of an .spz: one gzip stream (versions 1 to 3) or one ZSTD stream per attribute (version 4).

Sizes follow from the header's count and are checked before anything is allocated or unpacked.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from jaxtyping import UInt8
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.progress import report

MAGIC = b"NGSP"
GZIP_MAGIC = b"\x1f\x8b"
VERSIONS = (1, 2, 3, 4)
HARMONICS_WIDTHS = (0, 9, 24, 45, 72)
"""Bytes per splat, by SH degree."""
EXTENSIONS = "extensions"
"""Name of the last block that `read_blocks` yields."""
REMEDY = "Copy the file again, or export it again from the program that made it"
ANTIALIASED = 1
"""Flag of scenes that were trained with antialiasing."""
_HAS_EXTENSIONS = 2
_MAX_EXTENSION_BYTES = 1 << 20
_LEGACY_HEADER, _HEADER, _TOC_ENTRY = struct.Struct("<4sIIBBBB"), struct.Struct("<4sIIBBBBI12x"), struct.Struct("<QQ")
_ZSTD_LEVEL, _GZIP_LEVEL = 6, 6


@dataclass(frozen=True)
class SpzHeader:
    """The header that all versions have."""

    version: int
    count: int
    sh_degree: int
    fractional_bits: int
    flags: int = 0

    @property
    def widths(self) -> dict[str, int]:
        """Bytes per splat of each attribute, in the file's order."""
        return {
            "positions": 6 if self.version == 1 else 9,
            "alphas": 1,
            "colors": 3,
            "scales": 3,
            "rotations": 3 if self.version < 3 else 4,
            "harmonics": HARMONICS_WIDTHS[self.sh_degree],
        }


Blocks = Iterator[tuple[str, ndarray]]


def read_container(file: IO[bytes], path: Path, size: int) -> tuple[SpzHeader, Blocks]:
    """Read the header, and an iterator over each attribute's bytes (n, width), then those of the extensions (m,).

    Raises DataError, also while iterating, where anything is wrong or cut off.
    """
    start = file.read(4)
    file.seek(0)
    if start == MAGIC:
        return _read_streams(file, path, size)
    if start.startswith(GZIP_MAGIC):
        return _read_gzip(file, path, size)
    raise DataError(path, f"the file begins with {start!r}, not as a .spz does", "Check that it is a .spz file")


def write_container(
    file: IO[bytes], header: SpzHeader, parts: Callable[[str], Iterable[UInt8[ndarray, "m w"]]]
) -> None:
    """Write header and attributes; `parts` gives the bytes of each by its name, some rows at a time."""
    names = [name for name, width in header.widths.items() if width * header.count]
    common = (MAGIC, header.version, header.count, header.sh_degree, header.fractional_bits, header.flags)
    if header.version < 4:
        with gzip.GzipFile("", "wb", _GZIP_LEVEL, file, mtime=0) as packed:
            packed.write(_LEGACY_HEADER.pack(*common, 0))
            for number, name in enumerate(names):
                report(number / len(names))
                for part in parts(name):
                    packed.write(part.data)
        return
    file.write(_HEADER.pack(*common, len(names), _HEADER.size))
    file.write(bytes(_TOC_ENTRY.size * len(names)))
    compressor = zstandard.ZstdCompressor(level=_ZSTD_LEVEL, write_checksum=True)
    entries = []
    for name in names:
        start, size = file.tell(), header.widths[name] * header.count
        with compressor.stream_writer(file, size=size, closefd=False) as packed:
            for part in parts(name):
                packed.write(part.data)
        report(len(entries) / len(names))
        entries.append((file.tell() - start, size))
    file.seek(_HEADER.size)
    file.write(b"".join(_TOC_ENTRY.pack(*entry) for entry in entries))


def _read_gzip(file: IO[bytes], path: Path, size: int) -> tuple[SpzHeader, Blocks]:
    packed = gzip.GzipFile(fileobj=file)
    magic, *fields, _ = _LEGACY_HEADER.unpack(_unpack(packed, _LEGACY_HEADER.size, "header", path))
    if magic != MAGIC:
        raise DataError(path, f"the gzip content begins with {magic!r}, not {MAGIC!r}", "Check that it is a .spz file")
    header = _check_header(SpzHeader(*fields), path, size, VERSIONS[:3])
    return header, _read_gzip_blocks(packed, header, path)


def _read_gzip_blocks(packed: gzip.GzipFile, header: SpzHeader, path: Path) -> Blocks:
    for name, width in header.widths.items():
        yield (
            name,
            np.frombuffer(_unpack(packed, header.count * width, name, path), np.uint8).reshape(header.count, width),
        )
    limit = _MAX_EXTENSION_BYTES if header.flags & _HAS_EXTENSIONS else 0
    # One byte more than allowed: reaching the end also makes gzip compare its checksum.
    rest = _unpack(packed, limit + 1, EXTENSIONS, path, short=True)
    if len(rest) > limit:
        problem = f"more than {limit} bytes follow the {header.count} splats that the header promises"
        raise DataError(path, problem, REMEDY)
    yield EXTENSIONS, np.frombuffer(rest, np.uint8)


def _unpack(packed: gzip.GzipFile, wanted: int, name: str, path: Path, short: bool = False) -> bytearray:
    """Unpack the next `wanted` bytes (or, where `short`, up to that many)."""
    data, start = bytearray(wanted), 0
    with memoryview(data) as view:
        while start < wanted:
            try:
                read = packed.readinto(view[start:])
            except (gzip.BadGzipFile, EOFError, zlib.error) as error:
                raise DataError(path, f"the part {name!r} is damaged or cut off ({error})", REMEDY) from error
            if not read:
                break
            start += read
    if start < wanted:
        if not short:
            raise DataError(path, f"the part {name!r} ends after {start} of {wanted} bytes", REMEDY)
        del data[start:]
    return data


def _read_streams(file: IO[bytes], path: Path, size: int) -> tuple[SpzHeader, Blocks]:
    if size < _HEADER.size:
        raise DataError(path, f"the file ends after {size} of the header's {_HEADER.size} bytes", REMEDY)
    _, *fields, stream_count, toc_start = _HEADER.unpack(file.read(_HEADER.size))
    header = _check_header(SpzHeader(*fields), path, size, VERSIONS[3:])
    sizes = {name: width * header.count for name, width in header.widths.items() if width * header.count}
    if stream_count != len(sizes):
        raise DataError(path, f"the header's numStreams is {stream_count}, {len(sizes)} attributes need one", REMEDY)
    toc_end = toc_start + stream_count * _TOC_ENTRY.size
    if not _HEADER.size <= toc_start <= _HEADER.size + _MAX_EXTENSION_BYTES or toc_end > size:
        raise DataError(path, f"the header's tocByteOffset is {toc_start}, in a file of {size} bytes", REMEDY)
    records = file.read(toc_start - _HEADER.size) if header.flags & _HAS_EXTENSIONS else b""
    file.seek(toc_start)
    entries = list(_TOC_ENTRY.iter_unpack(file.read(toc_end - toc_start)))
    for (name, expected), (_, unpacked) in zip(sizes.items(), entries, strict=True):
        if unpacked != expected:
            problem = f"the stream of {name} promises {unpacked} bytes, {header.count} splats have {expected}"
            raise DataError(path, problem, REMEDY)
    if toc_end + sum(packed for packed, _ in entries) != size:
        problem = f"the streams end at byte {toc_end + sum(packed for packed, _ in entries)}, the file at {size}"
        raise DataError(path, problem, REMEDY)
    return header, _read_zstd_blocks(file, header, [packed for packed, _ in entries], records, path)


def _read_zstd_blocks(file: IO[bytes], header: SpzHeader, lengths: Iterable[int], records: bytes, path: Path) -> Blocks:
    remaining = iter(lengths)
    for name, width in header.widths.items():
        expected = width * header.count
        data = _decompress(file.read(next(remaining)), expected, name, path) if expected else b""
        yield name, np.frombuffer(data, np.uint8).reshape(header.count, width)
    yield EXTENSIONS, np.frombuffer(records, np.uint8)


def _decompress(packed: bytes, expected: int, name: str, path: Path) -> bytes:
    try:
        # A frame's own size is believed by the decoder: compare it before it can allocate by it.
        promised = zstandard.get_frame_parameters(packed).content_size
        if promised not in (expected, zstandard.CONTENTSIZE_UNKNOWN):
            raise DataError(path, f"the stream of {name} unpacks to {promised} bytes, not {expected}", REMEDY)
        data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=expected, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise DataError(path, f"the stream of {name} is damaged ({error})", REMEDY) from error
    if len(data) != expected:
        raise DataError(path, f"the stream of {name} unpacks to {len(data)} bytes, not {expected}", REMEDY)
    return data


def _check_header(header: SpzHeader, path: Path, size: int, versions: tuple[int, ...]) -> SpzHeader:
    if header.version not in versions:
        known = " or ".join(map(str, versions))
        raise DataError(
            path, f"the header's version is {header.version}, not {known}", "Export it as version 4 or older"
        )
    if header.sh_degree >= len(HARMONICS_WIDTHS):
        raise DataError(path, f"the header's shDegree is {header.sh_degree}, above 4", REMEDY)
    if header.fractional_bits > 24:
        raise DataError(path, f"the header's fractionalBits is {header.fractional_bits}, above 24", REMEDY)
    check_plausible_count(path, header.count, size)
    return header
