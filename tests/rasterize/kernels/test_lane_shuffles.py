"""Blocks of 4 × 4 pixels become rows of pictures, and records lanes and back, against numpy."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.lane_shuffles import (
    arrange_rows,
    interleave_lanes,
    load_columns,
    load_turned,
    pack_pairs,
    store_records,
    store_up_to,
    take_member,
)
from instdrive_core.rasterize.kernels.simd import load, load_block, store, store_block

ZERO, WIDTH = np.uint64(0), np.uint64(16)


@numba.njit(error_model="numpy")
def _rearranged(a, rows, turns, second):
    store_block(rows, ZERO, WIDTH, arrange_rows(load_block(4, a, ZERO, WIDTH)))
    three = load_block(3, a, ZERO, WIDTH)
    store_block(turns, ZERO, WIDTH, interleave_lanes(three))
    store(second, ZERO, take_member(three, 1))


def test_four_blocks_become_four_rows_and_three_channels_take_turns() -> None:
    a = np.arange(64, dtype=np.float32)
    rows, turns, second = np.zeros(64, np.float32), np.zeros(48, np.float32), np.zeros(16, np.float32)
    _rearranged(a, rows, turns, second)
    blocks = a.reshape(4, 4, 4)  # block, line, column
    np.testing.assert_array_equal(rows.reshape(4, 16), np.concatenate(list(blocks), axis=1))
    np.testing.assert_array_equal(turns, a[:48].reshape(3, 16).T.reshape(-1))
    np.testing.assert_array_equal(second, a[16:32])


@numba.njit(error_model="numpy")
def _stored(count, a, out):
    store_up_to(count, out, np.uint64(3), load(a, ZERO))


@pytest.mark.parametrize("count", [-5, 0, 1, 15, 16, 40])
def test_only_the_first_lanes_are_written(count: int) -> None:
    a, out = np.arange(1, 17, dtype=np.float32), np.zeros(24, np.float32)
    _stored(count, a, out)
    expected = np.zeros(24, np.float32)
    written = max(0, min(count, 16))
    expected[3 : 3 + written] = a[:written]
    np.testing.assert_array_equal(out, expected)


@numba.njit(error_model="numpy")
def _turned(a, places, wanted, threes, fours, turned, records):
    store_block(threes, ZERO, WIDTH, load_columns(3, a, np.uint64(1)))
    store_block(fours, ZERO, WIDTH, load_columns(4, a, np.uint64(2)))
    store_block(turned, ZERO, WIDTH, load_turned(a, places, np.uint64(3)))
    store_records(a, np.uint64(16), wanted, records, np.uint64(32))


@pytest.mark.parametrize("wanted", [0xFFFF, 0x8421, 0])
def test_records_become_lanes_and_lanes_records(wanted: int) -> None:
    a, places = np.arange(400, dtype=np.float32), np.arange(0, 320, 20).astype(np.uint64)[::-1].copy()
    threes, fours = np.zeros((3, 16), np.float32), np.zeros((4, 16), np.float32)
    turned, records = np.zeros((16, 16), np.float32), Workspace().get_array("records", (18, 16))
    records[:] = -1
    _turned(a, places, np.uint64(wanted), *(array.reshape(-1) for array in (threes, fours, turned, records)))
    np.testing.assert_array_equal(threes, a[1:49].reshape(16, 3).T)
    np.testing.assert_array_equal(fours, a[2:66].reshape(16, 4).T)
    np.testing.assert_array_equal(turned, (places[None] + 3 + np.arange(16)[:, None]).astype(np.float32))
    kept = np.array([wanted >> k & 1 for k in range(16)], bool)
    np.testing.assert_array_equal(records[2:][kept], a[16:272].reshape(16, 16).T[kept])
    assert (records[:2] == -1).all()
    assert (records[2:][~kept] == -1).all()


@numba.njit(error_model="numpy")
def _packed(numbers, out):
    four = load_block(4, numbers, ZERO, WIDTH)
    packed = pack_pairs(take_member(four, 0), take_member(four, 1), take_member(four, 2), take_member(four, 3))
    store_block(out, ZERO, WIDTH, packed)


def test_four_whole_numbers_are_packed_into_eight_bytes() -> None:
    numbers = np.random.default_rng(0).integers(0, 1 << 16, (4, 16)).astype(np.float32)
    out = np.zeros((16, 4), np.uint16)
    _packed(numbers.reshape(-1), out.view(np.float32).reshape(-1))
    np.testing.assert_array_equal(out, numbers.T)
