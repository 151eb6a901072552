import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from instdrive_core.instances.codebook import MAX_BITS, code_vectors, quantized


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_quantised_is_the_nearest_codeword(seed, bits):
    features = np.random.default_rng(seed).normal(size=(20, bits)).astype(np.float32)
    codebook = code_vectors(np.arange(1 << bits, dtype=np.uint32), bits)
    distances = ((np.tanh(features)[:, None] - codebook) ** 2).sum(axis=-1)
    np.testing.assert_array_equal(quantized(features), distances.argmin(axis=1))


@given(st.integers(1, MAX_BITS), st.data())
def test_code_vectors_quantise_to_their_number(bits, data):
    number = np.array([data.draw(st.integers(0, 2**bits - 1))], np.uint32)
    vector = code_vectors(number, bits)
    assert set(np.unique(vector)) <= {-1, 1}
    assert quantized(vector) == number


@pytest.mark.parametrize("bits", [0, MAX_BITS + 1])
def test_other_dimensions_are_refused(bits):
    with pytest.raises(ValueError, match=f"dimension is {bits}"):
        quantized(np.zeros((3, bits), np.float32))
