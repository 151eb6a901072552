"""PSNR and SSIM agree with scikit-image, and masked pixels have no influence."""

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from instdrive_core.evaluation.metrics.image_metrics import psnr, ssim


@pytest.fixture
def pair() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    truth = rng.random((40, 56, 3)).astype(np.float32)
    image = np.clip(truth + rng.normal(0, 0.1, truth.shape), 0, 1).astype(np.float32)
    return image, truth


def test_agrees_with_scikit_image(pair):
    image, truth = pair
    assert psnr(image, truth) == pytest.approx(peak_signal_noise_ratio(truth, image, data_range=1.0), abs=1e-4)
    expected = structural_similarity(
        truth, image, data_range=1.0, channel_axis=2, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    assert ssim(image, truth) == pytest.approx(expected, abs=1e-5)


def test_masked_pixels_have_no_influence(pair):
    image, truth = pair
    valid = np.ones(image.shape[:2], bool)
    valid[25:] = False
    spoiled = image.copy()
    spoiled[25:] = 0
    assert psnr(spoiled, truth, valid) == psnr(image, truth, valid) == pytest.approx(psnr(image[:25], truth[:25]))
    assert ssim(spoiled, truth, valid) == pytest.approx(ssim(image[:25], truth[:25]), abs=1e-7)
    assert ssim(spoiled, truth) != pytest.approx(ssim(spoiled, truth, valid), abs=0.1)


def test_equal_images_are_finite_and_best(pair):
    _, truth = pair
    assert psnr(truth, truth) == 100
    assert ssim(truth, truth) == pytest.approx(1)


def test_nothing_valid_is_none_not_zero(pair):
    image, truth = pair
    nowhere = np.zeros(image.shape[:2], bool)
    assert psnr(image, truth, nowhere) is None
    assert ssim(image, truth, nowhere) is None
    assert ssim(image[:8], truth[:8]) is None
