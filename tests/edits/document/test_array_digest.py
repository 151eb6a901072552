"""Digests of arrays: equal for equal bytes, different for any change of one."""

import numpy as np
import pytest

from instdrive_core.edits.document.array_digest import digest_array


@pytest.mark.parametrize("count", [0, 1, 127, 128, 129, 1000, 70_000])
def test_equal_bytes_have_equal_digests_and_every_changed_byte_shows(count):
    rng = np.random.default_rng(count)
    array = rng.integers(0, 256, count, dtype=np.uint8)
    digest = digest_array(array)
    assert digest_array(array.copy()) == digest
    for place in rng.integers(0, count, 50).tolist() if count else []:
        changed = array.copy()
        changed[place] ^= np.uint8(1 << rng.integers(0, 8))
        assert digest_array(changed) != digest


def test_the_order_of_words_counts_and_zeros_are_not_nothing():
    array = np.arange(4096, dtype=np.uint64)
    swapped = array.copy()
    swapped[[16, 32]] = swapped[[32, 16]]  # in one lane
    digests = {digest_array(each) for each in (array, swapped, array[::-1], np.zeros(4096), np.ones(4096))}
    assert len(digests) == 5


def test_parts_of_arrays_are_digested_by_what_they_hold():
    array = np.arange(10_000, dtype=np.uint32).reshape(100, 100)
    assert digest_array(array[:, ::2]) == digest_array(array[:, ::2].copy())
