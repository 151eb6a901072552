"""Blocks of 4 × 4 pixels become rows of pictures, against numpy."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from instdrive_core.rasterize.kernels.lane_shuffles import arrange_rows, interleave_lanes, store_up_to, take_member
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
