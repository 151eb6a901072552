"""Shuffles: blocks of 4 × 4 pixels into rows of pictures, and records of several numbers into lanes and back."""

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


@intrinsic(prefer_literal=True)
def load_columns(typingctx, count, array, place):
    """Load sixteen records of `count` numbers (a literal, 3 or 4) that lie side by side: lanes for each number."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    parts = count.literal_value

    def codegen(context, builder, signature, args):
        _, array, place = args
        rows = []
        for k in range(parts):
            at = builder.add(place, ir.IntType(64)(k * WIDTH))
            rows.append(_load_at(context, builder, signature.args[1], array, at))
        return _join_members(context, builder, signature, [_pick_every(builder, rows, part) for part in range(parts)])

    return LaneBlock(parts)(count, array, types.uint64), codegen


@intrinsic
def load_turned(typingctx, array, places, shift):
    """Load sixteen numbers from `shift` on of each of sixteen places (an array of uint64): lanes for each number."""

    def codegen(context, builder, signature, args):
        array, places, shift = args
        at, rows = context.make_array(signature.args[1])(context, builder, places).data, []
        for k in range(WIDTH):
            place = builder.add(builder.load(builder.gep(at, [_INT32(k)])), shift)
            rows.append(_load_at(context, builder, signature.args[0], array, place))
        return _join_members(context, builder, signature, _turn_square(builder, rows))

    return LaneBlock(WIDTH)(array, places, types.uint64), codegen


@intrinsic
def store_records(typingctx, source, place, wanted, target, target_place):
    """Turn sixteen lanes that lie one after the other into records, and write those wanted (bits of a uint64) to
    cache lines of another array past the caches: they are not read again soon."""

    def codegen(context, builder, signature, args):
        source, place, wanted, target, target_place = args
        places = [builder.add(place, ir.IntType(64)(k * WIDTH)) for k in range(WIDTH)]
        rows = _turn_square(builder, [_load_at(context, builder, signature.args[0], source, at) for at in places])
        data = context.make_array(signature.args[3])(context, builder, target).data
        aside = builder.module.add_metadata([_INT32(1)])
        all_of_them = builder.icmp_unsigned("==", wanted, wanted.type(0xFFFF))
        with builder.if_else(all_of_them) as (whole, part):
            for branch, chosen in ((whole, False), (part, True)):
                with branch:
                    for k, row in enumerate(rows):
                        bit = builder.trunc(builder.lshr(wanted, wanted.type(k)), ir.IntType(1))
                        with builder.if_then(bit if chosen else bit.type(1)):
                            at = builder.gep(data, [builder.add(target_place, ir.IntType(64)(k * WIDTH))])
                            stored = builder.store(row, builder.bitcast(at, _VECTOR.as_pointer()), align=4 * WIDTH)
                            stored.set_metadata("nontemporal", aside)
        return context.get_dummy_value()

    return types.void(source, types.uint64, types.uint64, target, types.uint64), codegen


@intrinsic
def pack_pairs(typingctx, first, second, third, fourth):
    """Pack four whole numbers below 65,536 into eight bytes, sixteen times: a block of two lanes, to be stored as they
    are."""

    def codegen(context, builder, signature, args):
        integers = ir.VectorType(_INT32, WIDTH)
        numbers = [builder.fptosi(value, integers) for value in args]
        shift = ir.Constant(integers, [16] * WIDTH)
        low, high = (builder.or_(numbers[k], builder.shl(numbers[k + 1], shift)) for k in (0, 2))
        halves = []
        for start in (0, WIDTH // 2):
            places = [start + k // 2 + (WIDTH if k % 2 else 0) for k in range(WIDTH)]
            halves.append(builder.bitcast(_pick_lanes(builder, low, high, places), _VECTOR))
        return _join_members(context, builder, signature, halves)

    return LaneBlock(2)(lanes, lanes, lanes, lanes), codegen


def _load_at(context, builder, array_type, array, place):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.load(builder.bitcast(builder.gep(data, [place]), _VECTOR.as_pointer()), align=4)


def _pick_every(builder, rows, part):
    """Pick number `part` of each record out of rows in which records lie side by side."""
    found = rows[0]
    for k, row in enumerate(rows):
        places = [lane * len(rows) + part - k * WIDTH for lane in range(WIDTH)]
        chosen = [WIDTH + place if 0 <= place < WIDTH else lane for lane, place in enumerate(places)]
        found = _pick_lanes(builder, found, row, chosen)
    return found


def _turn_square(builder, rows):
    """Transpose sixteen rows of sixteen: fours of each row first, which then change places as wholes.

    Each step is one that processors have an instruction for.
    """
    fours = range(0, WIDTH, _SIDE)
    ones = [[four + k for four in fours for k in (low, low + WIDTH, low + 1, low + 1 + WIDTH)] for low in (0, 2)]
    twos = [[four + k for four in fours for k in (low, low + 1, low + WIDTH, low + 1 + WIDTH)] for low in (0, 2)]
    turned = []
    for k in fours:
        near = [_pick_lanes(builder, rows[k], rows[k + 1], places) for places in ones]
        far = [_pick_lanes(builder, rows[k + 2], rows[k + 3], places) for places in ones]
        turned += [_pick_lanes(builder, near[half], far[half], places) for half in (0, 1) for places in twos]
    halves = [
        [_SIDE * four + k + side for side in (0, WIDTH) for four in (low, low + 2) for k in range(_SIDE)]
        for low in (0, 1)
    ]
    result = [rows[0]] * WIDTH
    for column in range(_SIDE):
        group = turned[column::_SIDE]
        for low, places in enumerate(halves):
            left, right = (_pick_lanes(builder, group[k], group[k + 1], places) for k in (0, 2))
            for high, chosen in enumerate(halves):
                result[_SIDE * (low + 2 * high) + column] = _pick_lanes(builder, left, right, chosen)
    return result
