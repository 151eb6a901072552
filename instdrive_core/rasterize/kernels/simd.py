"""Sixteen float32 side by side, a pixel row of a tile or a block of 4 × 4, as one value inside compiled kernels.

LLVM's own vectoriser reduces each row to a scalar before it begins the next and keeps nothing in registers from one
loop to another; written as vectors, sums and transmittances stay where they are. Where registers are narrower than
512 bits, LLVM splits each value. Arithmetic follows the fastmath flags of the kernel; a float32 beside lanes counts
for every lane. Places in arrays are uint64 and never checked.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic as numba_intrinsic
from numba.extending import models, overload, register_model

intrinsic: Any = numba_intrinsic
"""Callers leave out the first argument, which type checkers cannot know."""

WIDTH = 16
_VECTOR = ir.VectorType(ir.FloatType(), WIDTH)
_BITS = ir.VectorType(ir.IntType(1), WIDTH)
_INT16, _INT32, _INT64 = ir.IntType(16), ir.IntType(32), ir.IntType(64)


class Lanes(types.Type):
    """Sixteen float32."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


class LaneMask(types.Type):
    """Sixteen truth values."""

    def __init__(self) -> None:
        super().__init__(name="LaneMask")


class LaneBlock(types.Type):
    """Several `Lanes` that are treated alike, each in its own register."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"LaneBlock({count})")


lanes, lane_mask = Lanes(), LaneMask()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, _VECTOR)


@register_model(LaneMask)
class _LaneMaskModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, _BITS)


@register_model(LaneBlock)
class _LaneBlockModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, ir.ArrayType(_VECTOR, kind.count))


def _indices(values):
    return ir.Constant(ir.VectorType(_INT32, len(values)), values)


def _fill_vector(builder, scalar, width=WIDTH):
    """Make a vector with the scalar in every place."""
    undefined = ir.Constant(ir.VectorType(scalar.type, width), ir.Undefined)
    return builder.shuffle_vector(
        builder.insert_element(undefined, scalar, _INT32(0)), undefined, _indices([0] * width)
    )


def _widen_index(builder, kind, value):
    return value if isinstance(kind, Lanes) else _fill_vector(builder, value)


def _pointer(context, builder, array_type, array, place):
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [place])


def _load_vector(context, builder, array_type, array, place):
    pointer = builder.bitcast(_pointer(context, builder, array_type, array, place), _VECTOR.as_pointer())
    return builder.load(pointer, align=4)


def _store_vector(context, builder, array_type, array, place, value) -> None:
    pointer = builder.bitcast(_pointer(context, builder, array_type, array, place), value.type.as_pointer())
    builder.store(value, pointer, align=4)


def _step_index(builder, place, stride, count):
    """place + k · stride for k < count."""
    return [builder.add(place, builder.mul(stride, _INT64(k))) for k in range(count)]


# --- operators


def _lane_operator(symbol, build, result) -> None:
    """Make `symbol` work on lanes ∘ lanes, lanes ∘ float32 and float32 ∘ lanes."""

    @intrinsic
    def apply(typingctx, left, right):
        def codegen(context, builder, signature, args):
            return build(builder, *(_widen_index(builder, *side) for side in zip(signature.args, args, strict=True)))

        return result(left, right), codegen

    @overload(symbol)
    def implementation(left, right):
        if lanes in (left, right) and all(side in (lanes, types.float32) for side in (left, right)):
            return lambda left, right: apply(left, right)
        return None


_lane_operator(operator.add, lambda builder, a, b: builder.fadd(a, b), lanes)
_lane_operator(operator.iadd, lambda builder, a, b: builder.fadd(a, b), lanes)
_lane_operator(operator.sub, lambda builder, a, b: builder.fsub(a, b), lanes)
_lane_operator(operator.mul, lambda builder, a, b: builder.fmul(a, b), lanes)
_lane_operator(operator.truediv, lambda builder, a, b: builder.fdiv(a, b), lanes)
_lane_operator(operator.gt, lambda builder, a, b: builder.fcmp_ordered(">", a, b), lane_mask)
_lane_operator(operator.ge, lambda builder, a, b: builder.fcmp_ordered(">=", a, b), lane_mask)
_lane_operator(operator.le, lambda builder, a, b: builder.fcmp_ordered("<=", a, b), lane_mask)


@intrinsic
def _both(typingctx, left, right):
    return lane_mask(lane_mask, lane_mask), lambda context, builder, signature, args: builder.and_(*args)


@overload(operator.and_)
def _and(left, right):
    if left is lane_mask and right is lane_mask:
        return lambda left, right: _both(left, right)
    return None


# --- lane by lane


def _extreme(sign):
    def typed(typingctx, left, right):
        def codegen(context, builder, signature, args):
            a, b = (_widen_index(builder, *side) for side in zip(signature.args, args, strict=True))
            return builder.select(builder.fcmp_ordered(sign, a, b), a, b)

        return lanes(left, right), codegen

    return intrinsic(typed)


least, greatest = _extreme("<"), _extreme(">")
"""The smaller and the larger of two lanes."""


@intrinsic
def choose(typingctx, condition, yes, no):
    """`yes` where the condition holds, else `no`."""

    def codegen(context, builder, signature, args):
        sides = (_widen_index(builder, *side) for side in zip(signature.args[1:], args[1:], strict=True))
        return builder.select(args[0], *sides)

    return lanes(lane_mask, yes, no), codegen


@intrinsic
def magnitude(typingctx, value):
    """Absolute values."""

    def codegen(context, builder, signature, args):
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.fabs.v16f32"), args)

    return lanes(lanes), codegen


@intrinsic
def any_lane(typingctx, condition):
    """Whether the condition holds in any lane."""

    def codegen(context, builder, signature, args):
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], _INT16), _INT16(0))

    return types.boolean(lane_mask), codegen


@intrinsic
def pack_lane_bits(typingctx, condition):
    """Pack a condition into the bits of a uint16, the first lane's lowest."""

    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], _INT16)

    return types.uint16(lane_mask), codegen


@intrinsic
def unpack_lane_bits(typingctx, bits):
    """Unpack the bits of a uint16 into a condition: the inverse of `pack_lane_bits`."""
    return lane_mask(types.uint16), lambda context, builder, signature, args: builder.bitcast(args[0], _BITS)


@intrinsic
def exclude_lanes(typingctx, condition, exception):
    """Combine two conditions: the first holds and the exception does not."""

    def codegen(context, builder, signature, args):
        return builder.and_(args[0], builder.not_(args[1]))

    return lane_mask(lane_mask, lane_mask), codegen


@intrinsic
def fill_lanes(typingctx, value):
    """Put one float32 into every lane."""
    return lanes(types.float32), lambda context, builder, signature, args: _fill_vector(builder, args[0])


# --- memory


@intrinsic
def load(typingctx, array, place):
    """Load sixteen neighbours from a flat float32 array."""

    def codegen(context, builder, signature, args):
        return _load_vector(context, builder, signature.args[0], *args)

    return lanes(array, types.uint64), codegen


@intrinsic
def store(typingctx, array, place, value):
    """Write sixteen neighbours of a flat float32 array."""

    def codegen(context, builder, signature, args):
        _store_vector(context, builder, signature.args[0], *args)
        return context.get_dummy_value()

    return types.void(array, types.uint64, lanes), codegen


@intrinsic(prefer_literal=True)
def store_first(typingctx, count, array, place, value):
    """Write only the first `count` lanes (a literal)."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    first = _indices(list(range(count.literal_value)))

    def codegen(context, builder, signature, args):
        _, array, place, value = args
        _store_vector(context, builder, signature.args[1], array, place, builder.shuffle_vector(value, value, first))
        return context.get_dummy_value()

    return types.void(count, array, types.uint64, lanes), codegen


def _fetching(to_write):
    def typed(typingctx, array, place):
        def codegen(context, builder, signature, args):
            pointer = _pointer(context, builder, signature.args[0], *args)
            pointer = builder.bitcast(pointer, ir.IntType(8).as_pointer())
            kind = ir.FunctionType(ir.VoidType(), [pointer.type, _INT32, _INT32, _INT32])
            function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
            builder.call(function, [pointer, _INT32(to_write), _INT32(3), _INT32(1)])
            return context.get_dummy_value()

        return types.void(array, types.uint64), codegen

    return intrinsic(typed)


prefetch, prefetch_to_write = _fetching(0), _fetching(1)
"""Have the cache line at a place of an array fetched, for it will soon be read; or written."""


# --- blocks


@intrinsic(prefer_literal=True)
def make_zero_block(typingctx, count):
    """Make a block of `count` (a literal) times zero."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    block = LaneBlock(count.literal_value)
    return block(count), lambda context, builder, signature, args: ir.Constant(context.get_value_type(block), None)


@intrinsic
def build_block(typingctx, *members):
    """Build a block of the lanes given."""

    def codegen(context, builder, signature, args):
        block = ir.Constant(context.get_value_type(signature.return_type), ir.Undefined)
        for k in range(signature.return_type.count):
            block = builder.insert_value(block, builder.extract_value(args[0], k), k)
        return block

    count = len(members)
    return LaneBlock(count)(types.StarArgTuple([lanes] * count)), codegen


@intrinsic(prefer_literal=True)
def load_block(typingctx, count, array, place, stride):
    """`count` (a literal) times sixteen neighbours, `stride` apart."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    block_type = LaneBlock(count.literal_value)

    def codegen(context, builder, signature, args):
        _, array, place, stride = args
        block = ir.Constant(context.get_value_type(block_type), ir.Undefined)
        for k, at in enumerate(_step_index(builder, place, stride, block_type.count)):
            block = builder.insert_value(block, _load_vector(context, builder, signature.args[1], array, at), k)
        return block

    return block_type(count, array, types.uint64, types.uint64), codegen


@intrinsic
def store_block(typingctx, array, place, stride, block):
    """Write a block where `load_block` reads it."""

    def codegen(context, builder, signature, args):
        array, place, stride, block = args
        for k, at in enumerate(_step_index(builder, place, stride, signature.args[3].count)):
            _store_vector(context, builder, signature.args[0], array, at, builder.extract_value(block, k))
        return context.get_dummy_value()

    return types.void(array, types.uint64, types.uint64, block), codegen


@intrinsic
def add_scaled(typingctx, block, weight, array, place):
    """block[k] + weight · array[place + k]: one number of the array per member."""

    def codegen(context, builder, signature, args):
        block, weight, array, place = args
        for k, at in enumerate(_step_index(builder, place, _INT64(1), signature.args[0].count)):
            scalar = builder.load(_pointer(context, builder, signature.args[2], array, at))
            product = builder.fmul(weight, _fill_vector(builder, scalar))
            block = builder.insert_value(block, builder.fadd(builder.extract_value(block, k), product), k)
        return block

    return block(block, lanes, array, types.uint64), codegen


@intrinsic
def add_products(typingctx, block, weight, array, place, stride):
    """block[k] + weight · (sixteen neighbours in the array at place + k · stride)."""

    def codegen(context, builder, signature, args):
        block, weight, array, place, stride = args
        for k, at in enumerate(_step_index(builder, place, stride, signature.args[0].count)):
            product = builder.fmul(weight, _load_vector(context, builder, signature.args[2], array, at))
            block = builder.insert_value(block, builder.fadd(builder.extract_value(block, k), product), k)
        return block

    return block(block, lanes, array, types.uint64, types.uint64), codegen


@intrinsic
def add_contracted(typingctx, start, array, place, stride, values, first):
    """start + Σ values[first + k] · (sixteen neighbours in the array at place + k · stride) over k < 4."""

    def codegen(context, builder, signature, args):
        total, array, place, stride, values, first = args
        places, numbers = _step_index(builder, place, stride, 4), _step_index(builder, first, _INT64(1), 4)
        for at, number in zip(places, numbers, strict=True):
            scalar = builder.load(_pointer(context, builder, signature.args[4], values, number))
            row = _load_vector(context, builder, signature.args[1], array, at)
            total = builder.fadd(total, builder.fmul(row, _fill_vector(builder, scalar)))
        return total

    return lanes(lanes, array, types.uint64, types.uint64, values, types.uint64), codegen


@intrinsic
def sum_block(typingctx, block):
    """Lane k: the sum over the lanes of member k; 0 beyond the block (of at most sixteen).

    Members are added in pairs while they are interleaved, so that sixteen sums cost as much as three.
    """

    def codegen(context, builder, signature, args):
        count = signature.args[0].count
        rows = [builder.extract_value(args[0], k) for k in range(count)] + [None] * (WIDTH - count)
        distance = 1
        while len(rows) > 1:
            rows = [_sum_lane_pairs(builder, *pair, distance) for pair in zip(rows[::2], rows[1::2], strict=True)]
            distance *= 2
        return rows[0]

    return lanes(block), codegen


def _sum_lane_pairs(builder, left, right, distance):
    """Sums of lanes `distance` apart: those of `left` where that bit of the lane's number is 0, else of `right`."""
    if left is None:
        return None
    right = ir.Constant(_VECTOR, None) if right is None else right
    low = [k + WIDTH - distance if k & distance else k for k in range(WIDTH)]
    high = [k + WIDTH if k & distance else k + distance for k in range(WIDTH)]
    return builder.fadd(
        builder.shuffle_vector(left, right, _indices(low)), builder.shuffle_vector(left, right, _indices(high))
    )


# --- sets of bits


@intrinsic
def find_lowest_bit(typingctx, bits):
    """Find the number of the lowest bit that is set in a uint64 other than 0."""
    return types.uint64(types.uint64), lambda context, builder, signature, args: builder.cttz(args[0], ir.IntType(1)(1))


@intrinsic
def find_members_with(typingctx, sets, bit):
    """Find which of the first 64 uint16 of an array have bit number `bit` set; returns the bits of a uint64."""

    def codegen(context, builder, signature, args):
        kind = ir.VectorType(_INT16, 64)
        pointer = _pointer(context, builder, signature.args[0], args[0], _INT64(0))
        values = builder.load(builder.bitcast(pointer, kind.as_pointer()), align=2)
        wanted = _fill_vector(builder, builder.shl(_INT16(1), builder.trunc(args[1], _INT16)), 64)
        found = builder.icmp_unsigned("!=", builder.and_(values, wanted), ir.Constant(kind, None))
        return builder.bitcast(found, _INT64)

    return types.uint64(sets, types.uint64), codegen
