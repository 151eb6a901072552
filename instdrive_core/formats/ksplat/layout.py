"""Where things lie in a .ksplat: a header, the headers of its sections, and their splats in buckets.

The layout is that of GaussianSplats3D (M. Kellogg), version 0.1. Sizes follow from the headers' counts and are compared
with the file's before anything is allocated.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray

from instdrive_core.errors import DataError

HEADER_BYTES, SECTION_HEADER_BYTES = 4096, 1024
REMEDY = "Copy the file again, or export it again from the program that made it"
SH_COUNTS = (0, 3, 8)
"""Coefficients above the constant, by SH degree."""
DEFAULT_SH_RANGE = (-1.5, 1.5)
DEFAULT_QUANTISATION = 32767
_MAX_SECTIONS = 1 << 16
_HEADER, _SH_RANGE = struct.Struct("<BBxxIIIIH"), struct.Struct("<ff")
_SH_RANGE_START = 36
_SECTION = struct.Struct("<IIIIfHxxI4xIIH")
_WIDEST_BLOCK = 1e9


@dataclass(frozen=True)
class Precision:
    """How a compression level stores numbers."""

    centre: str
    """Numpy type of each coordinate; whole numbers are steps from the middle of the splat's bucket."""
    number: str
    """Numpy type of scales and rotations."""
    harmonic: str
    """Numpy type of each SH coefficient; bytes span the file's range."""

    def describe_record(self, sh_degree: int) -> np.dtype:
        """Describe the bytes of one splat."""
        return np.dtype(
            [
                ("centre", self.centre, 3),
                ("scale", self.number, 3),
                ("rotation", self.number, 4),
                ("color", "u1", 4),
                ("harmonics", self.harmonic, 3 * SH_COUNTS[sh_degree]),
            ]
        )


LEVELS = (Precision("<f4", "<f4", "<f4"), Precision("<u2", "<f2", "<f2"), Precision("<u2", "<f2", "u1"))
"""By compression level."""


@dataclass(frozen=True)
class KsplatHeader:
    """What the file says of all its sections."""

    count: int
    level: int
    sh_range: tuple[float, float]
    """What the bytes 0 and 255 of a coefficient stand for."""


@dataclass(frozen=True)
class Section:
    """A run of splats whose positions are stored relative to the middles of their buckets."""

    count: int
    start: int
    """Byte at which its buckets begin."""
    splat_start: int
    """Byte at which its splats begin."""
    record: np.dtype
    sh_degree: int
    step: float
    """Metres between two neighbouring whole numbers of a position."""
    middle: int
    """Whole number that stands for the middle of a bucket."""
    bucket_size: int
    full_buckets: int
    partial_buckets: int
    bucket_stride: int
    """Bytes of a bucket's middle and what follows it."""


def read_headers(file: BinaryIO, path: Path, size: int) -> tuple[KsplatHeader, list[Section]]:
    """Read and check the headers of a file of `size` bytes. Raises DataError."""
    data = file.read(HEADER_BYTES)
    if len(data) < HEADER_BYTES:
        raise DataError(path, f"the file ends after {len(data)} of the header's {HEADER_BYTES} bytes", REMEDY)
    major, minor, sections, _, _, count, level = _HEADER.unpack_from(data)  # full or not, all sections are there
    if major or not minor:
        problem = f"its version is {major}.{minor}, not 0.1 or later"
        raise DataError(path, problem, "Check that it is a .ksplat file; export it again with a current version")
    if level >= len(LEVELS):
        raise DataError(path, f"its compression level is {level}, none of 0, 1, 2", REMEDY)
    if not 0 < sections <= _MAX_SECTIONS:
        raise DataError(path, f"it says to have {sections} sections", REMEDY)
    low, high = _SH_RANGE.unpack_from(data, _SH_RANGE_START)
    sh_range = (low or DEFAULT_SH_RANGE[0], high or DEFAULT_SH_RANGE[1])
    if not (all(map(math.isfinite, sh_range)) and sh_range[0] < sh_range[1]):
        raise DataError(path, f"its SH coefficients range from {sh_range[0]:g} to {sh_range[1]:g}", REMEDY)
    start = HEADER_BYTES + sections * SECTION_HEADER_BYTES
    if start > size:
        raise DataError(path, f"the headers of {sections} sections end at byte {start}, the file at {size}", REMEDY)
    headers = file.read(sections * SECTION_HEADER_BYTES)
    found = []
    for number in range(sections):
        section, start = _parse_section(headers[number * SECTION_HEADER_BYTES :], number, level, start, path)
        if start > size:
            problem = f"section {number} of {section.count} splats ends at byte {start}, the file at {size}"
            raise DataError(path, problem, REMEDY)
        found.append(section)
    if start != size:
        raise DataError(path, f"its {sections} sections end at byte {start}, the file at {size}", REMEDY)
    total = sum(section.count for section in found)
    if total != count or not total:
        raise DataError(path, f"the header promises {count} splats, its sections have {total}", REMEDY)
    return KsplatHeader(count, level, sh_range), found


def read_bucket_middles(file: BinaryIO, section: Section, path: Path) -> Float32[ndarray, "buckets 3"]:
    """Read the middles of a section's buckets (metres). Raises DataError."""
    file.seek(section.start + 4 * section.partial_buckets)
    buckets = section.full_buckets + section.partial_buckets
    data = np.fromfile(file, np.uint8, buckets * section.bucket_stride)
    if len(data) < buckets * section.bucket_stride:
        raise DataError(path, "the file ends within the buckets of a section", REMEDY)
    middles = data.reshape(buckets, section.bucket_stride)[:, :12].copy().view("<f4")
    if not np.isfinite(middles).all():
        raise DataError(path, "the middle of a bucket is not finite", REMEDY)
    return middles


def locate_buckets(file: BinaryIO, section: Section, path: Path) -> Int64[ndarray, " ends"]:
    """Find the row after the last splat of each bucket: full ones come first. Raises DataError where the buckets do not
    hold the section's splats."""
    file.seek(section.start)
    lengths = np.fromfile(file, "<u4", section.partial_buckets).astype(np.int64)
    ends = np.cumsum(np.r_[np.full(section.full_buckets, section.bucket_size, np.int64), lengths])
    held = int(ends[-1]) if len(ends) else 0
    if len(lengths) < section.partial_buckets or held != section.count:
        raise DataError(path, f"the buckets of a section hold {held} splats, its header says {section.count}", REMEDY)
    return ends


def _parse_section(data: bytes, number: int, level: int, start: int, path: Path) -> tuple[Section, int]:
    """Parse the header of a section that starts at byte `start`; also where the section ends."""
    count, most, bucket_size, buckets, width, stride, middle, full, partial, degree = _SECTION.unpack_from(data)
    where = f"section {number}"
    if degree >= len(SH_COUNTS):
        raise DataError(path, f"{where} has SH degree {degree}, none of 0, 1, 2", REMEDY)
    if count > most:
        raise DataError(path, f"{where} has {count} of at most {most} splats", REMEDY)
    splat_start = start + 4 * partial + stride * buckets
    if level and (full + partial != buckets or stride < 12 or not 0 < width < _WIDEST_BLOCK):
        problem = f"{where} has {full} full and {partial} other of {buckets} buckets, {width:g} m wide, {stride} bytes"
        raise DataError(path, problem, REMEDY)
    middle = middle or DEFAULT_QUANTISATION
    record = LEVELS[level].describe_record(degree)
    step = 0.5 * width / middle if level else 0.0
    section = Section(count, start, splat_start, record, degree, step, middle, bucket_size, full, partial, stride)
    return section, splat_start + record.itemsize * most
