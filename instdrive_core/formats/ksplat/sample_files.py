"""A small .ksplat of every level, written by the layout's description: for tests and fuzzing."""

import struct
from typing import Any

import numpy as np

from instdrive_core.formats.ksplat.layout import HEADER_BYTES, LEVELS, SECTION_HEADER_BYTES, SH_COUNTS

BUCKET_SIZE = 16
WIDTH = 5.0


def build_ksplat(rng, sections, level=1, minor=1):
    """Bytes of a file whose sections have `sections` splats and SH degrees: [(count, degree), …]."""
    total = sum(count for count, _ in sections)
    header = bytearray(HEADER_BYTES)
    struct.pack_into("<BBxxIIIIH", header, 0, 0, minor, len(sections), len(sections), total, total, level)
    struct.pack_into("<ff", header, 36, -0.8, 0.9)
    heads, bodies = [], []
    for count, degree in sections:
        head, body = _build_section(rng, count, degree, level)
        heads.append(head)
        bodies.append(body)
    return bytes(header) + b"".join(heads) + b"".join(bodies)


def _build_section(rng, count, degree, level):
    full, left = (divmod(count, BUCKET_SIZE)) if level else (0, 0)
    partial = [left - left // 3, left // 3] if left > 2 else [left] if left else []
    buckets = full + len(partial)
    middle = 32767 if level else 1
    head = bytearray(SECTION_HEADER_BYTES)
    fields = (count, count + 3, BUCKET_SIZE, buckets, WIDTH, 12, middle, full, len(partial), degree)
    struct.pack_into("<IIIIfHxxI4xIIH", head, 0, *fields)
    records: Any = np.zeros(count + 3, LEVELS[level].describe_record(degree))
    if level:
        records["centre"] = rng.integers(0, 65535, (count + 3, 3))
    else:
        records["centre"] = rng.normal(0, 20, (count + 3, 3))
    records["scale"] = rng.uniform(0.01, 0.5, (count + 3, 3))
    quats = rng.normal(size=(count + 3, 4))
    records["rotation"] = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    records["color"] = rng.integers(1, 255, (count + 3, 4))
    shape = (count + 3, 3 * SH_COUNTS[degree])
    records["harmonics"] = rng.integers(0, 255, shape) if level == 2 else rng.uniform(-0.5, 0.5, shape)
    middles = rng.normal(0, 30, (buckets, 3)).astype("<f4")
    return bytes(head), np.array(partial, "<u4").tobytes() + middles.tobytes() + records.tobytes()
