import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from instdrive_core.instances.codebook import MAX_BITS, decode_codewords, quantize_features


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_quantised_is_the_nearest_codeword(seed, bits):
    features = np.random.default_rng(seed).normal(size=(20, bits)).astype(np.float32)
    codebook = decode_codewords(np.arange(1 << bits, dtype=np.uint32), bits)
    distances = ((np.tanh(features)[:, None] - codebook) ** 2).sum(axis=-1)
    np.testing.assert_array_equal(quantize_features(features), distances.argmin(axis=1))


@given(st.integers(1, MAX_BITS), st.data())
def test_code_vectors_quantise_to_their_number(bits, data):
    number = np.array([data.draw(st.integers(0, 2**bits - 1))], np.uint32)
    vector = decode_codewords(number, bits)
    assert set(np.unique(vector)) <= {-1, 1}
    assert quantize_features(vector) == number


@pytest.mark.parametrize("bits", [0, MAX_BITS + 1])
def test_other_dimensions_are_refused(bits):
    with pytest.raises(ValueError, match=f"dimension is {bits}"):
        quantize_features(np.zeros((3, bits), np.float32))
