import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from instdrive_core.maths.sh_rotation import compute_rest_rotation, rotate_rest
from instdrive_core.maths.spherical_harmonics import (
    REST_COUNTS,
    Y0,
    color_from_dc,
    dc_from_color,
    evaluate_rest_basis,
    evaluate_view_colors,
)


def random_directions(count, seed=0):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def real_harmonic(degree, order, directions):
    """The textbook definition: Condon-Shortley phase kept, as 3DGS does."""
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    value = sph_harm_y(degree, abs(order), polar, azimuth)
    if order == 0:
        return value.real
    return np.sqrt(2) * (value.imag if order < 0 else value.real)


def test_basis_is_the_real_harmonics_in_order():
    directions = random_directions(50)
    expected = [
        real_harmonic(degree, order, directions) for degree in (1, 2, 3) for order in range(-degree, degree + 1)
    ]
    np.testing.assert_allclose(evaluate_rest_basis(directions, 15), np.stack(expected, axis=1), atol=1e-9)


@pytest.mark.parametrize("count", REST_COUNTS)
def test_lower_degrees_are_prefixes(count):
    directions = random_directions(10)
    np.testing.assert_array_equal(
        evaluate_rest_basis(directions, count), evaluate_rest_basis(directions, 15)[:, :count]
    )


def test_colors_are_clamped_below_only():
    dc = dc_from_color(np.array([[-0.5, 0.25, 2.0]], np.float32))
    np.testing.assert_allclose(color_from_dc(dc), [[-0.5, 0.25, 2.0]], atol=1e-6)
    shown = evaluate_view_colors(dc, np.zeros((1, 0, 3), np.float32), np.array([[0, 0, 1.0]], np.float32))
    np.testing.assert_allclose(shown, [[0, 0.25, 2.0]], atol=1e-6)
    assert pytest.approx(0.5 / np.sqrt(np.pi)) == Y0


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(REST_COUNTS))
def test_turned_coefficients_show_the_same_from_the_turned_side(seed, count):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(rng=rng).as_matrix()
    rest, directions = rng.normal(size=(4, count, 3)), random_directions(30, seed)
    before = np.einsum("dk,nkc->ndc", evaluate_rest_basis(directions, count), rest)
    after = np.einsum("dk,nkc->ndc", evaluate_rest_basis(directions @ rotation.T, count), rotate_rest(rest, rotation))
    np.testing.assert_allclose(after, before, atol=1e-10)


def test_rotation_matrices_are_orthogonal_and_keep_degrees_apart():
    matrix = compute_rest_rotation(Rotation.from_euler("xyz", [0.3, -1.1, 2.0]).as_matrix(), 15)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(15), atol=1e-12)
    for block in (slice(0, 3), slice(3, 8), slice(8, 15)):
        outside = matrix[block].copy()
        outside[:, block] = 0
        np.testing.assert_allclose(outside, 0, atol=1e-12)
