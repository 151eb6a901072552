"""Which exposure a camera has at a time."""

import numpy as np
import pytest

from instdrive_core.scene.exposure import Exposures, apply_exposure, create_identity_exposure


@pytest.fixture
def exposures() -> Exposures:
    """Three photos of the front camera out of order, one of the back camera."""
    keys = ("front_camera/20", "front_camera/00", "back_camera/00", "front_camera/10")
    matrices = np.random.default_rng(0).normal(size=(4, 3, 4)).astype(np.float32)
    return Exposures(keys, np.array([2.0, 0.0, 0.1, 1.0]), matrices)


def test_a_photo_has_its_own(exposures):
    for key, time, matrix in zip(exposures.keys, exposures.times, exposures.matrices, strict=True):
        np.testing.assert_array_equal(exposures.interpolate(key.split("/")[0], float(time)), matrix)


def test_between_photos_of_the_same_camera_it_is_linear_and_clamped_outside(exposures):
    late, early, back, middle = exposures.matrices
    np.testing.assert_allclose(exposures.interpolate("front_camera", 0.25), 0.75 * early + 0.25 * middle, atol=1e-6)
    np.testing.assert_allclose(exposures.interpolate("front_camera", 1.5), (middle + late) / 2, atol=1e-6)
    np.testing.assert_array_equal(exposures.interpolate("front_camera", -3.0), early)
    np.testing.assert_array_equal(exposures.interpolate("front_camera", 30.0), late)
    np.testing.assert_array_equal(exposures.interpolate("back_camera", 7.0), back)


def test_an_unknown_camera_has_the_identity(exposures):
    np.testing.assert_array_equal(exposures.interpolate("left_camera", 0.0), np.eye(3, 4))
    empty = Exposures((), np.zeros(0), np.zeros((0, 3, 4), np.float32))
    np.testing.assert_array_equal(empty.interpolate("front_camera", 0.0), np.eye(3, 4))


def test_exposing_is_affine_and_the_identity_keeps_every_bit():
    image = np.random.default_rng(1).random((4, 5, 3)).astype(np.float32)
    np.testing.assert_array_equal(apply_exposure(image, create_identity_exposure()), image)
    matrix = np.random.default_rng(2).normal(size=(3, 4)).astype(np.float32)
    found = apply_exposure(image, matrix)
    np.testing.assert_allclose(found[2, 3], matrix @ np.append(image[2, 3], 1), rtol=1e-5)
    assert found.dtype == np.float32


def test_what_does_not_fit_together_is_refused(exposures):
    keys, times, matrices = exposures.keys, exposures.times, exposures.matrices
    with pytest.raises(ValueError, match="3 photos have"):
        Exposures(keys[:3], times, matrices)
    with pytest.raises(ValueError, match="twice"):
        Exposures((keys[0], *keys[:3]), times, matrices)
    broken = matrices.copy()
    broken[2, 1, 3] = np.nan
    with pytest.raises(ValueError, match="back_camera/00 is not finite"):
        Exposures(keys, times, broken)
