"""The vectors that kernels are written with, against numpy."""

from __future__ import annotations

import numba
import numpy as np

from instdrive_core.rasterize.kernels.simd import (
    add_contracted,
    add_products,
    add_scaled,
    any_lane,
    build_block,
    choose,
    exclude_lanes,
    fill_lanes,
    find_lowest_bit,
    find_members_with,
    greatest,
    least,
    load,
    load_block,
    magnitude,
    make_zero_block,
    pack_lane_bits,
    prefetch,
    store,
    store_block,
    store_first,
    sum_block,
    unpack_lane_bits,
)

ZERO = np.uint64(0)


def _numbers(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=count).astype(np.float32)


@numba.njit(error_model="numpy")
def _operators(a, b, scalar, out):
    x, y, total = load(a, ZERO), load(b, ZERO), fill_lanes(scalar)
    total += x
    results = (x + y, x - scalar, scalar * x, x / y, total, least(x, y), greatest(scalar, x), magnitude(x))
    for k in range(8):
        store(out, np.uint64(16 * k), results[k])


def test_operators_take_lanes_and_numbers_on_either_side() -> None:
    a, b, scalar = _numbers(16), _numbers(16, 1), np.float32(0.3)
    out = np.zeros((8, 16), np.float32)
    _operators(a, b, scalar, out.reshape(-1))
    expected = (
        a + b,
        a - scalar,
        scalar * a,
        a / b,
        scalar + a,
        np.minimum(a, b),
        np.maximum(scalar, a),
        np.abs(a),
    )
    np.testing.assert_array_equal(out, expected)


@numba.njit(error_model="numpy")
def _choices(a, b, out):
    x, y = load(a, ZERO), load(b, ZERO)
    above, below, far = x > y, x <= y, x >= np.float32(100)
    store(out, ZERO, choose(above, x, np.float32(-7)))
    store(out, np.uint64(16), choose(below & (x > np.float32(0)), np.float32(1), y))
    return any_lane(above), any_lane(above & below), any_lane(far)


def test_comparisons_choose_lane_by_lane() -> None:
    a, b, out = _numbers(16), _numbers(16, 1), np.zeros((2, 16), np.float32)
    assert _choices(a, b, out.reshape(-1)) == (True, False, False)
    np.testing.assert_array_equal(out[0], np.where(a > b, a, -7))
    np.testing.assert_array_equal(out[1], np.where((a <= b) & (a > 0), 1, b))


@numba.njit(error_model="numpy")
def _blocks(a, stride, scalars, out):
    prefetch(a, ZERO)
    weight = load(a, np.uint64(3))
    four = load_block(4, a, np.uint64(1), stride)
    store_block(out, ZERO, np.uint64(16), add_scaled(four, weight, scalars, np.uint64(2)))
    store_block(out, np.uint64(64), np.uint64(16), add_products(make_zero_block(4), weight, a, np.uint64(1), stride))
    store(out, np.uint64(128), add_contracted(weight, a, np.uint64(1), stride, scalars, np.uint64(2)))


def test_blocks_are_read_weighted_and_contracted() -> None:
    a, scalars, out = _numbers(80), _numbers(6, 1), np.zeros((9, 16), np.float32)
    _blocks(a, np.uint64(17), scalars, out.reshape(-1))
    weight, rows = a[3:19], np.stack([a[1 + 17 * k :][:16] for k in range(4)])
    np.testing.assert_allclose(out[:4], rows + weight * scalars[2:, None], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(out[4:8], weight * rows, rtol=1e-6)
    np.testing.assert_allclose(out[8], weight + scalars[2:] @ rows, rtol=1e-5, atol=1e-6)


@numba.njit(error_model="numpy")
def _sums(a, out):
    store(out, ZERO, sum_block(load_block(12, a, ZERO, np.uint64(16))))
    x = load(a, ZERO)
    store_first(3, out, np.uint64(16), sum_block(build_block(x, x + x, np.float32(3) * x, x)))


def test_sums_of_a_block_lie_in_its_lanes_and_no_more_than_asked_is_written() -> None:
    a, out = _numbers(12 * 16), np.full(32, 9, np.float32)
    _sums(a, out)
    sums = a.reshape(12, 16).sum(axis=1)
    np.testing.assert_allclose(out[:12], sums, rtol=1e-4, atol=1e-5)
    assert not out[12:16].any()
    np.testing.assert_allclose(out[16:19], sums[0] * np.array([1, 2, 3]), rtol=1e-4)
    assert (out[19:] == 9).all()


@numba.njit(error_model="numpy")
def _bits(sets, bit):
    found = find_members_with(sets, bit)
    return found, find_lowest_bit(found)


def test_members_of_sets_are_found_as_bits() -> None:
    sets = np.random.default_rng(0).integers(0, 1 << 16, 64).astype(np.uint16)
    for bit in (0, 7, 15):
        members = [k for k in range(64) if sets[k] >> bit & 1]
        found, lowest = _bits(sets, np.uint64(bit))
        assert found == sum(1 << k for k in members)
        assert lowest == members[0]


@numba.njit(error_model="numpy")
def _conditions(a, bits, out):
    x = load(a, ZERO)
    given, above = unpack_lane_bits(bits), x > np.float32(0)
    store(out, ZERO, choose(given, x, np.float32(9)))
    return pack_lane_bits(given), pack_lane_bits(above), pack_lane_bits(exclude_lanes(above, given))


def test_conditions_and_bits_are_each_others_reverse() -> None:
    a, out, bits = _numbers(16), np.zeros(16, np.float32), np.uint16(0b1010_0000_0000_0111)
    given, above, only_above = _conditions(a, bits, out)
    assert given == bits
    assert above == sum(1 << k for k in range(16) if a[k] > 0)
    assert only_above == above & ~int(bits)
    np.testing.assert_array_equal(out, np.where([int(bits) >> k & 1 for k in range(16)], a, 9))
