"""The RGB term against scikit-image and finite differences."""

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from instdrive_core.training.photometric import photometric_loss, ssim_and_gradient


def pair(shape=(3, 26, 37), seed=0):
    rng = np.random.default_rng(seed)
    x = rng.random(shape).astype(np.float32)
    return x, np.clip(x + rng.normal(0, 0.1, shape), 0, 1).astype(np.float32)


def test_ssim_equals_scikit_image_on_zero_padded_images():
    x, y = pair()
    ours, _ = ssim_and_gradient(x, y)
    padded = [np.pad(image, ((0, 0), (12, 12), (12, 12))).transpose(1, 2, 0) for image in (x, y)]
    _, theirs = structural_similarity(
        *padded,
        channel_axis=2,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    assert ours == pytest.approx(theirs[12:-12, 12:-12].mean(), abs=1e-4)


def test_ssim_gradient_is_that_of_finite_differences():
    x, y = pair((3, 14, 17))
    _, gradient = ssim_and_gradient(x, y)
    rng, step = np.random.default_rng(1), 1e-2
    for _ in range(30):
        at = tuple(rng.integers(0, size) for size in x.shape)
        plus, minus = x.copy(), x.copy()
        plus[at] += step
        minus[at] -= step
        numeric = (ssim_and_gradient(plus, y)[0] - ssim_and_gradient(minus, y)[0]) * x.size / (2 * step)
        assert gradient[at] == pytest.approx(numeric, rel=0.03, abs=0.02)


def test_loss_has_the_gradient_of_both_terms():
    x, y = (torch.from_numpy(array.transpose(1, 2, 0).copy()) for array in pair((3, 12, 15)))
    x.requires_grad_(True)
    loss = photometric_loss(x, y, None, 0.2)
    loss.backward()
    direction = torch.randn(y.shape, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        step = 1e-3
        difference = photometric_loss(x + step * direction, y, None, 0.2) - photometric_loss(
            x - step * direction, y, None, 0.2
        )
    assert float((x.grad * direction).sum()) == pytest.approx(float(difference) / (2 * step), rel=0.05)


def test_the_ego_vehicle_counts_in_neither_value_nor_gradient():
    image, target = torch.rand(32, 30, 3, requires_grad=True), torch.rand(32, 30, 3)
    valid = torch.ones(32, 30, dtype=torch.bool)
    valid[20:] = False
    first = photometric_loss(image, target, valid, 0.2)
    first.backward()
    assert float(image.grad[20:].abs().max()) == 0
    with torch.no_grad():
        image[20:] = 0
    assert float(photometric_loss(image, target, valid, 0.2).detach()) == pytest.approx(float(first.detach()))


def test_equal_images_cost_nothing():
    image = torch.rand(16, 16, 3)
    assert float(photometric_loss(image, image, None, 0.2)) == pytest.approx(0, abs=1e-6)
