"""The words of a .compressed.ply: three values of 11, 10 and 11 bits, a rotation of 2 + 3 × 10 bits, a colour of 4 × 8.

Layout after the format's description by PlayCanvas (blog.playcanvas.com/compressing-gaussian-splats, 2023).
All values are float64 on the unpacked side; the first component stands in a word's highest bits.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, UInt8, UInt32
from numpy import ndarray

from instdrive_core.maths.rotations import normalize_quaternions

VECTOR_BITS = (11, 10, 11)
COLOR_BITS = (8, 8, 8, 8)
_ROTATION_BITS = (10, 10, 10)
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""The three components that are stored when this one (wxyz) is the largest."""
SH_LIMIT = 4.0
"""SH coefficients are stored from -4 to 4."""


def pack_units(units: Float64[ndarray, "n k"], bits: tuple[int, ...]) -> UInt32[ndarray, " n"]:
    """Pack values of 0 to 1 into words, as whole numbers of so many bits each; values outside are cut off."""
    words = np.zeros(len(units), np.uint32)
    for column, width in enumerate(bits):
        most = (1 << width) - 1
        values = np.clip(np.floor(units[:, column] * most + 0.5), 0, most)
        words = words << np.uint32(width) | values.astype(np.uint32)
    return words


def unpack_units(words: UInt32[ndarray, " n"], bits: tuple[int, ...]) -> Float64[ndarray, "n k"]:
    """Unpack what `pack_units` packed."""
    units = np.empty((len(words), len(bits)))
    shift = sum(bits)
    for column, width in enumerate(bits):
        shift -= width
        most = (1 << width) - 1
        units[:, column] = (words >> np.uint32(shift) & np.uint32(most)) / most
    return units


def pack_rotations(quats: Float64[ndarray, "n 4"]) -> UInt32[ndarray, " n"]:
    """Pack quaternions wxyz of any length: the place of the largest component, and the other three from -√½ to √½."""
    unit = normalize_quaternions(quats)
    largest = np.argmax(np.abs(unit), axis=1)
    sign = np.where(np.take_along_axis(unit, largest[:, None], axis=1) < 0, -1, 1)
    others = np.take_along_axis(sign * unit, _OTHERS[largest], axis=1)
    return largest.astype(np.uint32) << np.uint32(30) | pack_units(others * np.sqrt(0.5) + 0.5, _ROTATION_BITS)


def unpack_rotations(words: UInt32[ndarray, " n"]) -> Float64[ndarray, "n 4"]:
    """Unpack unit quaternions wxyz; the largest component, which is not stored, is positive."""
    others = (unpack_units(words, _ROTATION_BITS) - 0.5) * np.sqrt(2)
    missing = np.sqrt(np.maximum(1 - (others**2).sum(axis=1), 0))
    largest = (words >> np.uint32(30)).astype(np.intp)
    quats = np.empty((len(words), 4))
    np.put_along_axis(quats, _OTHERS[largest], others, axis=1)
    np.put_along_axis(quats, largest[:, None], missing[:, None], axis=1)
    # Three stored values of a damaged word can be longer than 1 together.
    return normalize_quaternions(quats)


def encode_sh_bytes(values: Float64[ndarray, "*n"]) -> UInt8[ndarray, "*n"]:
    """Encode SH coefficients as bytes: steps of 1/32 from -4 to 4, cut off beyond."""
    return np.clip(np.floor((values / (2 * SH_LIMIT) + 0.5) * 256), 0, 255).astype(np.uint8)


def decode_sh_bytes(stored: UInt8[ndarray, "*n"]) -> Float64[ndarray, "*n"]:
    """Decode bytes as the middle of each one's step; 0 and 255 stand for the limits themselves."""
    units = np.where(stored == 0, 0, np.where(stored == 255, 1, (stored + 0.5) / 256))
    return (units - 0.5) * (2 * SH_LIMIT)
