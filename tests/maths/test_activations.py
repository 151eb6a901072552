import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from instdrive_core.maths.activations import logit, sigmoid


@given(st.floats(-12, 12))
def test_logit_inverts_sigmoid(value):
    np.testing.assert_allclose(logit(sigmoid(np.array([value]))), [value], rtol=1e-6, atol=1e-9)


def test_extremes_stay_finite():
    np.testing.assert_array_equal(sigmoid(np.array([-1e4, 1e4, -np.inf, np.inf])), [0, 1, 0, 1])
    assert np.isfinite(logit(np.array([0.0, 1.0]))).all()
