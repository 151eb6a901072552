"""Codewords that stay apart."""

import numpy as np
import pytest

from instdrive_core.instances.codebook import MAX_BITS
from instdrive_core.instances.separated_codes import MIN_DISTANCE, generate_separated_codewords


@pytest.mark.parametrize("count", [1, 2, 3, 5, 16, 17, 100, 257, 2048])
def test_any_two_differ_in_at_least_four_bits(count):
    codes, bits = generate_separated_codewords(count)
    assert len(np.unique(codes)) == count
    assert int(codes.max()) < 2**bits
    different = codes[:, None] ^ codes[None]
    distances = np.bitwise_count(different)[~np.eye(count, dtype=bool)]
    assert count == 1 or distances.min() >= MIN_DISTANCE


def test_bits_follow_the_count():
    assert generate_separated_codewords(256)[1] == 13
    assert generate_separated_codewords(2048)[1] == 16
    bits = [generate_separated_codewords(count)[1] for count in (2, 10, 100, 1000, 10_000)]
    assert bits == sorted(bits)
    assert bits[-1] <= MAX_BITS


def test_too_many_are_refused():
    with pytest.raises(ValueError, match="do not fit"):
        generate_separated_codewords(2**26 + 1)
