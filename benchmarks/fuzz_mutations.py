"""Damage to bytes: cuts, flips, lying counts, values that are no numbers, splices. `fuzz_containers` goes inside."""

from __future__ import annotations

import math
import random
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass

MAX_SIZE = 2 << 20
"""Bytes to which a file is let grow by repetition."""
INTEGERS = (
    0,
    1,
    2,
    3,
    255,
    256,
    65535,
    65536,
    400_001,
    2**24,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**33,
    2**63 - 1,
    2**64 - 1,
)
FLOATS = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1e38, -1e38, 1e-42, 1e300, -1.0)
WORDS = (
    *("nan", "inf", "-inf", "1e999", "-1", "0", "1e38", "0x10", "1_0", "18446744073709551616", "9" * 5000, "٣", ""),
    *("../../etc/passwd", "\0", "null", "[]", "x" * 70_000),
)


@dataclass(frozen=True)
class Damage:
    """A damaged file."""

    data: bytes
    what: str
    """What was done to it."""
    must_show: bool = False
    """Whether no file damaged like this may be read as if it were whole."""


Mutation = Callable[[bytes, random.Random], Damage]


def cut_off(data: bytes, rng: random.Random) -> Damage:
    """The end is missing."""
    kept = rng.choice((rng.randrange(len(data)), len(data) - 1 - rng.randrange(min(len(data), 64)))) if data else 0
    return Damage(data[:kept], f"cut at {kept} of {len(data)}", not _is_unnoticeable_tail(data[kept:]))


def _is_unnoticeable_tail(tail: bytes) -> bool:
    """Blanks, or the last digits of a text: what is left is a whole text, too."""
    return len(tail.split()) < 2 and not any(byte > 126 or byte < 9 for byte in tail) and not set(tail) & set(b"}]")


def flip(data: bytes, rng: random.Random) -> Damage:
    """Some bits are wrong."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        if changed:
            changed[_place(data, rng)] ^= 1 << rng.randrange(8)
    return Damage(bytes(changed), "bits flipped")


def overwrite(data: bytes, rng: random.Random) -> Damage:
    """A run of bytes is wrong."""
    start, length = _place(data, rng), rng.choice((1, 4, 16, 256))
    filling = rng.choice((b"\0" * length, b"\xff" * length, rng.randbytes(length)))
    return Damage(data[:start] + filling + data[start + length :], f"{length} bytes overwritten at {start}")


def insert(data: bytes, rng: random.Random) -> Damage:
    """Bytes too many."""
    start = _place(data, rng)
    return Damage(data[:start] + rng.randbytes(rng.choice((1, 2, 7, 300))) + data[start:], f"inserted at {start}")


def remove(data: bytes, rng: random.Random) -> Damage:
    """Bytes missing in the middle."""
    start = _place(data, rng)
    return Damage(data[:start] + data[start + rng.choice((1, 2, 7, 300)) :], f"removed at {start}")


def repeat(data: bytes, rng: random.Random) -> Damage:
    """A part stands there again, or often."""
    start = _place(data, rng)
    part = data[start : start + rng.choice((1, 16, 400, len(data)))]
    times = rng.choice((1, 2, 50))
    return Damage((data[:start] + part * times + data[start:])[: max(MAX_SIZE, len(data))], f"repeated at {start}")


def integer(data: bytes, rng: random.Random) -> Damage:
    """A count, size or offset lies: somewhere, mostly where headers are."""
    size, value = rng.choice((1, 2, 4, 8)), rng.choice(INTEGERS)
    start = _place(data, rng)
    number = (value % 2 ** (8 * size)).to_bytes(size, rng.choice(("little", "big")))
    return Damage(data[:start] + number + data[start + size :], f"{value} as {size} bytes at {start}")


def small_step(data: bytes, rng: random.Random) -> Damage:
    """A byte, count or index is a little too large or too small."""
    changed = bytearray(data)
    if changed:
        start = _place(data, rng)
        changed[start] = (changed[start] + rng.choice((-1, 1, 2, -2))) % 256
    return Damage(bytes(changed), "a byte off by little")


def float_value(data: bytes, rng: random.Random) -> Damage:
    """NaN, infinity, zeros (a zero quaternion) or giants among the values."""
    form = rng.choice("<>") + rng.choice("fd")
    value = rng.choice(FLOATS)
    packed = struct.pack(form, value if form[1] == "d" or not math.isfinite(value) else max(-3e38, min(3e38, value)))
    packed *= rng.choice((1, 1, 3, 4, 20))
    body = max(data.find(b"end_header\n") + 11, 0) if data[:3] == b"ply" else 0
    start = body + rng.randrange(max(len(data) - len(packed) - body, 1)) // 4 * 4 + rng.choice((0, 0, 0, 1, 2, 3))
    return Damage(data[:start] + packed + data[start + len(packed) :], f"{value} at {start}")


def word(data: bytes, rng: random.Random) -> Damage:
    """A number or word in a text is another, too large, or no number."""
    found = list(re.finditer(rb"[\w.+-]+", data[:60_000]))
    if not found:
        return Damage(data, "nothing")
    match = rng.choice(found)
    new = rng.choice((*WORDS, str(rng.choice(INTEGERS)), match[0].decode(errors="replace") * 2))
    return Damage(data[: match.start()] + new.encode() + data[match.end() :], f"{match[0][:20]!r} became {new[:20]!r}")


def lines(data: bytes, rng: random.Random) -> Damage:
    """A line is missing, stands twice, or two have changed places."""
    rows = data.split(b"\n")
    first, second = rng.randrange(min(len(rows), 80)), rng.randrange(min(len(rows), 80))
    match rng.randrange(3):
        case 0:
            del rows[first]
        case 1:
            rows.insert(first, rows[second])
        case _:
            rows[first], rows[second] = rows[second], rows[first]
    return Damage(b"\n".join(rows), f"line {first}")


def empty_file(data: bytes, rng: random.Random) -> Damage:
    """Nothing is left, or only zeros."""
    return Damage(rng.choice((b"", bytes(len(data)), b"\n")), "emptied")


def ply_count(data: bytes, rng: random.Random) -> Damage:
    """The header of a .ply promises another number of rows."""
    found = list(re.finditer(rb"element \w+ (\d+)\n", data[:20_000]))
    if not found:
        return word(data, rng)
    match = rng.choice(found)
    count = int(match[1])
    new = rng.choice((count - 1, count + 1, count // 2, 2 * count, 10 * count, *INTEGERS, 10**30))
    changed = data[: match.start(1)] + str(max(new, 0)).encode() + data[match.end(1) :]
    return Damage(changed, f"{match[0][:-1]!r} became {new}", max(new, 0) != count)


def ply_type(data: bytes, rng: random.Random) -> Damage:
    """A property of a .ply has another type or name, or is gone."""
    found = list(re.finditer(rb"property (\w+) (\w+)\n", data[:20_000]))
    if not found:
        return word(data, rng)
    match = rng.choice(found)
    kind = rng.choice((b"double", b"uchar", b"list uchar int", b"short", b"float", b"quad"))
    line = rng.choice((b"property " + kind + b" " + match[2] + b"\n", b"", match[0] * 2, b"property float zz\n"))
    return Damage(data[: match.start()] + line + data[match.end() :], f"{match[0][:-1]!r} became {line!r}")


BYTES: tuple[Mutation, ...] = (
    *(cut_off, cut_off, flip, flip, overwrite, insert, remove, repeat, integer, integer, small_step, small_step),
    *(float_value, float_value, word, lines, empty_file),
)
"""For any file; those that find most stand twice."""
PLY: tuple[Mutation, ...] = (ply_count, ply_count, ply_type, word, lines, *[float_value] * 4)


def _place(data: bytes, rng: random.Random) -> int:
    """Anywhere, mostly near the start or the end, where headers and directories are."""
    span = rng.choice((16, 64, 400, *[len(data)] * 4))
    place = rng.randrange(max(min(span, len(data)), 1))
    return place if rng.random() < 0.8 else max(len(data) - 1 - place, 0)
