import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation, Slerp

from instdrive_core.maths.rotations import (
    matrix_from_quaternion,
    multiply_quaternions,
    normalize_quaternions,
    quaternion_from_matrix,
    slerp,
)

quaternions = hnp.arrays(np.float64, 4, elements=st.floats(-1, 1)).filter(lambda q: np.linalg.norm(q) > 0.1)


def scipy_matrix(quat):
    return Rotation.from_quat(quat, scalar_first=True).as_matrix()


@given(quaternions)
def test_matrix_agrees_with_scipy(quat):
    np.testing.assert_allclose(matrix_from_quaternion(quat), scipy_matrix(quat), atol=1e-12)


@given(quaternions)
def test_matrix_and_back_is_the_same_rotation_with_positive_w(quat):
    back = quaternion_from_matrix(matrix_from_quaternion(quat))
    assert back[0] >= 0
    np.testing.assert_allclose(matrix_from_quaternion(back), scipy_matrix(quat), atol=1e-9)


@given(quaternions, quaternions)
def test_product_rotates_by_right_then_left(left, right):
    product = matrix_from_quaternion(multiply_quaternions(left, right))
    np.testing.assert_allclose(product, scipy_matrix(left) @ scipy_matrix(right), atol=1e-9)


@given(quaternions, quaternions, st.floats(0, 1))
def test_slerp_agrees_with_scipy(start, end, fraction):
    start, end = normalize_quaternions(start), normalize_quaternions(end)
    angle = Rotation.from_matrix(scipy_matrix(start).T @ scipy_matrix(end)).magnitude()
    if angle > np.pi - 0.05:
        return  # Nearly opposite: both arcs are as short.
    rotations = Rotation.from_quat(np.stack([start, end]), scalar_first=True)
    expected = Slerp([0, 1], rotations)(fraction).as_matrix()
    np.testing.assert_allclose(matrix_from_quaternion(slerp(start, end, fraction)), expected, atol=1e-3)


def test_zero_quaternion_is_the_identity():
    np.testing.assert_array_equal(matrix_from_quaternion(np.zeros((2, 4))), np.stack([np.eye(3)] * 2))


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_survive_the_way_back(axis):
    matrix = -np.eye(3)
    matrix[axis, axis] = 1
    np.testing.assert_allclose(matrix_from_quaternion(quaternion_from_matrix(matrix)), matrix, atol=1e-12)
