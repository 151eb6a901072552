"""Functions of sixteen float32 at once: roots, rounding, exponentials and logarithms, inside compiled kernels.

Exponential and logarithm are those of Moshier's Cephes library in single precision: right to two units in the last
place.
"""

from __future__ import annotations

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils

from instdrive_core.rasterize.kernels.simd import WIDTH, greatest, intrinsic, lanes, least

_VECTOR, _INTEGERS = ir.VectorType(ir.FloatType(), WIDTH), ir.VectorType(ir.IntType(32), WIDTH)
_MANTISSA, _BIAS, _ROOT_HALF = 23, 127, 0x3F3504F3
"""Bits of a float's mantissa, what its exponent is stored with, and the bits of √½."""
_FLAGS = {"nsz", "arcp", "contract", "afn"}
_LOG2_E = np.float32(np.log2(np.e))
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
_LEAST, _MOST = np.float32(-87), np.float32(88)


def _fill_integers(number):
    return ir.Constant(_INTEGERS, [number] * WIDTH)


def _calling(name):
    def typed(typingctx, value):
        def codegen(context, builder, signature, args):
            kind = ir.FunctionType(_VECTOR, [_VECTOR])
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v16f32"), args)

        return lanes(lanes), codegen

    return intrinsic(typed)


take_root, round_down, round_up, round_to_even = (_calling(name) for name in ("sqrt", "floor", "ceil", "rint"))
"""Square roots; the integer below, above, and the nearest."""


@intrinsic
def multiply_by_power(typingctx, value, power):
    """value · 2^power for whole powers from -126 to 127."""

    def codegen(context, builder, signature, args):
        number = builder.add(builder.fptosi(args[1], _INTEGERS), _fill_integers(_BIAS))
        factor = builder.bitcast(builder.shl(number, _fill_integers(_MANTISSA)), _VECTOR)
        return builder.fmul(args[0], factor)

    return lanes(lanes, lanes), codegen


def _find_power(builder, value):
    """The whole power of two by which a positive number exceeds one between √½ and √2, and the number's bits."""
    bits = builder.bitcast(value, _INTEGERS)
    return builder.ashr(builder.sub(bits, _fill_integers(_ROOT_HALF)), _fill_integers(_MANTISSA)), bits


@intrinsic
def extract_power(typingctx, value):
    """The power of two p for which value · 2^-p lies between √½ and √2; values are positive."""

    def codegen(context, builder, signature, args):
        return builder.sitofp(_find_power(builder, args[0])[0], _VECTOR)

    return lanes(lanes), codegen


@intrinsic
def remove_power(typingctx, value):
    """value · 2^-p for the p of `extract_power`."""

    def codegen(context, builder, signature, args):
        power, bits = _find_power(builder, args[0])
        return builder.bitcast(builder.sub(bits, builder.shl(power, _fill_integers(_MANTISSA))), _VECTOR)

    return lanes(lanes), codegen


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=_FLAGS)
def exponentiate(value):
    """e^value; values beyond -87 … 88 count as these, and what is no number as -87."""
    value = least(greatest(value, _LEAST), _MOST)
    power = round_to_even(value * _LOG2_E)
    x = value - power * _LN2_HIGH - power * _LN2_LOW
    y = np.float32(1.9875691500e-4) * x + np.float32(1.3981999507e-3)
    y = y * x + np.float32(8.3334519073e-3)
    y = y * x + np.float32(4.1665795894e-2)
    y = y * x + np.float32(1.6666665459e-1)
    y = y * x + np.float32(5.0000001201e-1)
    return multiply_by_power(y * x * x + x + np.float32(1), power)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=_FLAGS)
def take_logarithm(value):
    """Natural logarithms of positive values."""
    power, x = extract_power(value), remove_power(value) - np.float32(1)
    square = x * x
    y = np.float32(7.0376836292e-2) * x - np.float32(1.1514610310e-1)
    y = y * x + np.float32(1.1676998740e-1)
    y = y * x - np.float32(1.2420140846e-1)
    y = y * x + np.float32(1.4249322787e-1)
    y = y * x - np.float32(1.6668057665e-1)
    y = y * x + np.float32(2.0000714765e-1)
    y = y * x - np.float32(2.4999993993e-1)
    y = y * x + np.float32(3.3333331174e-1)
    y = y * x * square + power * _LN2_LOW - np.float32(0.5) * square
    return x + y + power * _LN2_HIGH
