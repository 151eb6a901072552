"""Uniform numbers that are hashes: the same question gets the same answer in every photo."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Integer
from numpy import ndarray


@dataclass(frozen=True)
class RepeatedDraws:
    """Answers that stay the same over photos, but for a share of them (`flip`) that are drawn anew in each photo."""

    seed: int
    photo: str
    """Key of the photo."""
    flip: float
    """Share of the answers that hold in this photo only."""

    def draw(self, question: str, *keys: Integer[ndarray, " _"] | int) -> Float64[ndarray, " n"]:
        """Draw a number in [0, 1) for each row of `keys`.

        Args:
            question: what is asked; other questions get independent answers.
            keys: whole numbers that tell the rows apart (object, part, block of steps, …).
        """
        lasting = _hash((self.seed, zlib.crc32(question.encode())), keys)
        own = (self.seed, zlib.crc32(question.encode()), zlib.crc32(self.photo.encode()))
        passing = _hash((*own, 1), keys)
        return np.where(_hash((*own, 2), keys) < self.flip, passing, lasting)

    def draw_once(self, question: str, *keys: Integer[ndarray, " _"] | int) -> Float64[ndarray, " n"]:
        """Draw as `draw`, but for this photo alone."""
        own = (self.seed, zlib.crc32(question.encode()), zlib.crc32(self.photo.encode()), 3)
        return _hash(own, keys)


def _hash(start: tuple[int, ...], keys: tuple[Integer[ndarray, " _"] | int, ...]) -> Float64[ndarray, " n"]:
    """Mix whole numbers into uniform ones: SplitMix64's finaliser (Steele, Lea & Flood 2014) after each number."""
    arrays = np.broadcast_arrays(*[np.atleast_1d(np.asarray(key, np.int64)) for key in keys])
    state = np.zeros(arrays[0].shape, np.uint64)
    with np.errstate(over="ignore"):
        for number in (*start, *arrays):
            state = _mix(state + np.asarray(number).astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15))
    return (state >> np.uint64(11)).astype(np.float64) / float(1 << 53)


def _mix(state: ndarray) -> ndarray:
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))
