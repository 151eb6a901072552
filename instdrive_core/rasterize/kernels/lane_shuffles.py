"""Shuffles that turn lanes holding blocks of 4 × 4 pixels into rows of pictures."""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types

from instdrive_core.rasterize.kernels.simd import WIDTH, LaneBlock, intrinsic, lanes

_VECTOR, _INT32 = ir.VectorType(ir.FloatType(), WIDTH), ir.IntType(32)
_SIDE = 4
"""Pixels of a block along each axis."""


def _constant(numbers):
    return ir.Constant(ir.VectorType(_INT32, len(numbers)), numbers)


def _pick_lanes(builder, left, right, places):
    """Pick lanes of `left` and, counted on, of `right`."""
    return builder.shuffle_vector(left, right, _constant(places))


def _join_members(context, builder, signature, members):
    block = ir.Constant(context.get_value_type(signature.return_type), ir.Undefined)
    for k, member in enumerate(members):
        block = builder.insert_value(block, member, k)
    return block


@intrinsic
def arrange_rows(typingctx, blocks):
    """Arrange four blocks of 4 × 4 pixels, side by side, as four rows of sixteen."""

    def codegen(context, builder, signature, args):
        first, second, third, fourth = (builder.extract_value(args[0], k) for k in range(_SIDE))
        rows = []
        for line in range(_SIDE):
            of_one = range(_SIDE * line, _SIDE * (line + 1))
            of_two = [*of_one, *(WIDTH + lane for lane in of_one)]
            left, right = _pick_lanes(builder, first, second, of_two), _pick_lanes(builder, third, fourth, of_two)
            rows.append(_pick_lanes(builder, left, right, list(range(WIDTH))))
        return _join_members(context, builder, signature, rows)

    return LaneBlock(_SIDE)(LaneBlock(_SIDE)), codegen


@intrinsic
def interleave_lanes(typingctx, three):
    """Interleave three lanes to forty-eight numbers: red, green, blue, red, …"""

    def codegen(context, builder, signature, args):
        red, green, blue = (builder.extract_value(args[0], k) for k in range(3))
        parts = []
        for first in range(0, 3 * WIDTH, WIDTH):
            turns = [divmod(place, 3) for place in range(first, first + WIDTH)]
            two = _pick_lanes(builder, red, green, [lane + WIDTH * (turn == 1) for lane, turn in turns])
            thirds = [WIDTH + lane if turn == 2 else place for place, (lane, turn) in enumerate(turns)]
            parts.append(_pick_lanes(builder, two, blue, thirds))
        return _join_members(context, builder, signature, parts)

    return LaneBlock(3)(LaneBlock(3)), codegen


@intrinsic(prefer_literal=True)
def take_member(typingctx, block, number):
    """Take the lanes of a block with this number (a literal)."""
    if not isinstance(number, types.IntegerLiteral):
        return None
    place = number.literal_value
    return lanes(block, number), lambda context, builder, signature, args: builder.extract_value(args[0], place)


@intrinsic
def store_up_to(typingctx, count, array, place, value):
    """Write the first `count` lanes (an int64; all from sixteen on) to a flat float32 array."""

    def codegen(context, builder, signature, args):
        count, array, place, value = args
        count = builder.select(builder.icmp_signed("<", count, count.type(WIDTH)), count, count.type(WIDTH))
        kind = ir.VectorType(_INT32, WIDTH)
        count = builder.insert_element(ir.Constant(kind, ir.Undefined), builder.trunc(count, _INT32), _INT32(0))
        wanted = builder.icmp_signed(
            "<", _constant(list(range(WIDTH))), _pick_lanes(builder, count, count, [0] * WIDTH)
        )
        data = context.make_array(signature.args[1])(context, builder, array).data
        pointer = builder.bitcast(builder.gep(data, [place]), _VECTOR.as_pointer())
        function = ir.FunctionType(ir.VoidType(), [_VECTOR, pointer.type, _INT32, wanted.type])
        store = cgutils.get_or_insert_function(builder.module, function, "llvm.masked.store.v16f32.p0")
        builder.call(store, [value, pointer, _INT32(4), wanted])
        return context.get_dummy_value()

    return types.void(types.int64, array, types.uint64, lanes), codegen
