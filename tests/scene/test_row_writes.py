"""Writing to many rows at once: what comes back, and rows that are not there."""

import numpy as np
import pytest

from instdrive_core.scene.row_writes import change_bits, exchange_values


def test_numbers_are_exchanged_and_their_bounds_come_back():
    numbers = np.arange(10, dtype=np.uint16)
    before, low, high = exchange_values(numbers, np.array([7, 2, 5]), np.array([70, 20, 50], np.uint16))
    assert before.tolist() == [7, 2, 5]
    assert (low, high) == (2, 8)
    assert numbers.tolist() == [0, 1, 20, 3, 4, 50, 6, 70, 8, 9]


def test_only_rows_that_change_come_back():
    flags = np.array([0b01, 0b11, 0b00, 0b10], np.uint8)
    changed, low, high = change_bits(flags, np.array([3, 1, 2]), np.uint8(0b01), True)
    assert changed.tolist() == [3, 2]
    assert (low, high) == (2, 4)
    assert flags.tolist() == [0b01, 0b11, 0b01, 0b11]
    changed, low, high = change_bits(flags, np.array([0, 1]), np.uint8(0b11), False)
    assert changed.tolist() == [1], "only where all of the bits are set"
    assert flags.tolist() == [0b01, 0b00, 0b01, 0b11]


@pytest.mark.parametrize("row", [-1, 4])
def test_a_row_that_is_not_there_is_refused_and_nothing_written(row):
    flags = np.zeros(4, np.uint8)
    with pytest.raises(IndexError):
        change_bits(flags, np.array([0, row]), np.uint8(1), True)
    with pytest.raises(IndexError):
        exchange_values(flags, np.array([0, row]), np.ones(2, np.uint8))
    with pytest.raises(IndexError):
        exchange_values(flags, np.array([0, 1]), np.ones(1, np.uint8))
    assert not flags.any()
