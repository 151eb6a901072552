"""The quantised attributes of an .spz, from bytes to values and back, a block of splats at a time.

Layouts after the reference implementation (nianticlabs/spz); bytes come as (n, width) uint8, one row per splat.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray

from instdrive_core.maths.rotations import normalize_quaternions

MAX_FRACTIONAL_BITS = 12
"""A step of 0.24 mm, which leaves ±2048 m."""
COLOR_SCALE = 0.15
"""Colour byte = 255 (0.15 sh_dc + 0.5): room for colours below 0 and above 1."""
LOG_SCALE_LIMITS = (-10.0, 5.9375)
COLOR_LIMIT = 0.5 / COLOR_SCALE
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""Quaternion components (xyzw) that are stored, by the one that is not."""


def choose_fractional_bits(extent: float) -> int | None:
    """Choose the most fractional bits that hold coordinates up to `extent` (metres) in 24 bits; None where none do."""
    fitting = (bits for bits in range(MAX_FRACTIONAL_BITS, -1, -1) if extent * 2**bits <= 2**23 - 1)
    return next(fitting, None)


def decode_fixed(data: UInt8[ndarray, "n 9"], fractional_bits: int) -> Float32[ndarray, "n 3"]:
    """Decode positions from 24-bit signed fixed point."""
    low, middle, high = np.moveaxis(data.reshape(-1, 3, 3).astype(np.int32), -1, 0)
    values = ((low | middle << 8 | high << 16) ^ 0x800000) - 0x800000
    return values.astype(np.float32) * np.float32(0.5**fractional_bits)


def encode_fixed(positions: Float[ndarray, "n 3"], fractional_bits: int) -> UInt8[ndarray, "n 9"]:
    """Encode what `decode_fixed` decodes; positions must fit."""
    values = np.rint(positions * np.float64(2**fractional_bits)).astype("<i4")
    return values.view(np.uint8).reshape(-1, 3, 4)[:, :, :3].reshape(-1, 9)


def decode_halves(data: UInt8[ndarray, "n 6"]) -> Float32[ndarray, "n 3"]:
    """Decode positions of version 1 from half-precision floats."""
    return data.view("<f2").astype(np.float32)


def encode_halves(positions: Float[ndarray, "n 3"]) -> UInt8[ndarray, "n 6"]:
    """Encode what `decode_halves` decodes; positions must be below 65504."""
    return positions.astype("<f2").view(np.uint8)


def decode_first_three(data: UInt8[ndarray, "n 3"]) -> Float[ndarray, "n 4"]:
    """Decode unit quaternions wxyz of versions 1 and 2: x, y, z in 8 bits, from which w ≥ 0 follows."""
    vector = data / 127.5 - 1.0
    w = np.sqrt(np.maximum(0.0, 1.0 - np.sum(vector**2, axis=1, keepdims=True)))
    return normalize_quaternions(np.concatenate([w, vector], axis=1))


def encode_first_three(quats: Float[ndarray, "n 4"]) -> UInt8[ndarray, "n 3"]:
    """Encode what `decode_first_three` decodes for quaternions wxyz of any length above 0."""
    units = normalize_quaternions(quats.astype(np.float64))
    return _round_to_bytes(127.5 * np.where(units[:, :1] < 0, -1, 1) * units[:, 1:] + 127.5)


def decode_smallest_three(data: UInt8[ndarray, "n 4"]) -> Float[ndarray, "n 4"]:
    """Decode unit quaternions wxyz of versions 3 and 4: sign and 9 bits for each component but the largest."""
    words = data.view("<u4")
    largest = (words >> 30).astype(np.int64)
    fields = (words >> np.array([20, 10, 0], np.uint32)) & 0x3FF
    stored = (fields & 0x1FF) * (math.sqrt(0.5) / 0x1FF) * np.where(fields >> 9, -1.0, 1.0)
    units = np.empty((len(data), 4))
    np.put_along_axis(units, _OTHERS[largest[:, 0]], stored, axis=1)
    rest = np.sqrt(np.maximum(0.0, 1.0 - np.sum(stored**2, axis=1, keepdims=True)))
    np.put_along_axis(units, largest, rest, axis=1)
    return normalize_quaternions(units[:, [3, 0, 1, 2]])


def encode_smallest_three(quats: Float[ndarray, "n 4"]) -> UInt8[ndarray, "n 4"]:
    """Encode what `decode_smallest_three` decodes for quaternions wxyz of any length above 0."""
    units = normalize_quaternions(quats.astype(np.float64))[:, [1, 2, 3, 0]]
    largest = np.argmax(np.abs(units), axis=1)[:, None]
    stored = np.take_along_axis(units, _OTHERS[largest[:, 0]], axis=1)
    negative = (stored < 0) ^ (np.take_along_axis(units, largest, axis=1) < 0)
    steps = np.minimum(np.rint(np.abs(stored) * (0x1FF / math.sqrt(0.5))), 0x1FF).astype(np.uint32)
    fields = (steps | negative.astype(np.uint32) << 9) << np.array([20, 10, 0], np.uint32)
    words = fields[:, 0] | fields[:, 1] | fields[:, 2] | largest[:, 0].astype(np.uint32) << 30
    return words.astype("<u4")[:, None].view(np.uint8)


def decode_log_scales(data: UInt8[ndarray, "n 3"]) -> Float32[ndarray, "n 3"]:
    """Decode log scales in steps of 1/16."""
    return data * np.float32(1 / 16) - np.float32(10)


def encode_log_scales(log_scales: Float[ndarray, "n 3"]) -> UInt8[ndarray, "n 3"]:
    """Encode what `decode_log_scales` decodes, cut off at `LOG_SCALE_LIMITS`."""
    return _round_to_bytes((log_scales + 10.0) * 16.0)


def decode_colors(data: UInt8[ndarray, "n 3"]) -> Float[ndarray, "n 3"]:
    """Decode colours as `sh_dc`."""
    return (data / 255.0 - 0.5) / COLOR_SCALE


def encode_colors(sh_dc: Float[ndarray, "n 3"]) -> UInt8[ndarray, "n 3"]:
    """Encode what `decode_colors` decodes, cut off at ±`COLOR_LIMIT`."""
    return _round_to_bytes(255.0 * (COLOR_SCALE * sh_dc + 0.5))


def encode_opacities(opacities: Float[ndarray, " n"]) -> UInt8[ndarray, "n 1"]:
    """Encode opacities of 0 … 1 in steps of 1/255."""
    return _round_to_bytes(255.0 * opacities)[:, None]


def encode_harmonics(sh_rest: Float[ndarray, "n k 3"], bits: tuple[int, int]) -> UInt8[ndarray, "n w"]:
    """Encode SH above the constant in steps of 1/128, rounded to `bits` (degree 1, higher degrees), cut off at ±1."""
    steps = np.array([1 << 8 - bits[0]] * 3 + [1 << 8 - bits[1]] * max(sh_rest.shape[1] - 3, 0))
    buckets = steps[: sh_rest.shape[1], None]
    values = np.rint(128.0 * np.clip(sh_rest, -1, 1))
    return _round_to_bytes(np.floor((values + 128 + buckets // 2) / buckets) * buckets).reshape(len(sh_rest), -1)


def decode_harmonics(data: UInt8[ndarray, "n w"], sh_rest: Float32[ndarray, "n k 3"]) -> None:
    """Fill `sh_rest` from bytes, coefficient-major; coefficients that it has no room for are left out."""
    np.copyto(sh_rest, data.reshape(len(data), -1, 3)[:, : sh_rest.shape[1]])
    sh_rest -= 128
    sh_rest *= np.float32(1 / 128)


def _round_to_bytes(values: ndarray) -> UInt8[ndarray, "..."]:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)
