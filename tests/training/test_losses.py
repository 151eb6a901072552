"""The RGB stage's losses against scikit-image and hand-made cases."""

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from instdrive_core.training import losses


def test_ssim_equals_scikit_image_away_from_the_border():
    rng = np.random.default_rng(0)
    x = rng.random((40, 60, 3)).astype(np.float32)
    y = np.clip(x + rng.normal(0, 0.1, x.shape), 0, 1).astype(np.float32)
    ours = losses.ssim_map(torch.from_numpy(x), torch.from_numpy(y)).numpy().transpose(1, 2, 0)
    _, theirs = structural_similarity(
        x, y, channel_axis=2, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, full=True
    )
    np.testing.assert_allclose(ours[6:-6, 6:-6], theirs[6:-6, 6:-6], atol=2e-4)


def test_photometric_loss_ignores_the_ego_vehicle():
    image, target = torch.rand(32, 32, 3), torch.rand(32, 32, 3)
    valid = torch.ones(32, 32, dtype=torch.bool)
    valid[20:] = False
    first = losses.photometric_loss(image, target, valid, 0.2)
    image[20:] = 0
    assert float(losses.photometric_loss(image, target, valid, 0.2)) == pytest.approx(float(first))
    assert float(losses.photometric_loss(target, target, None, 0.2)) == pytest.approx(0, abs=1e-6)


def test_depth_loss_is_metres_where_lidar_knows():
    depth, alpha = torch.full((2, 2), 4.5), torch.full((2, 2), 0.5)
    lidar = torch.tensor([[10.0, 0.0], [0.0, 8.0]])
    assert float(losses.depth_loss(depth, alpha, lidar)) == pytest.approx(1.0)
    assert float(losses.depth_loss(depth, alpha, torch.zeros(2, 2))) == 0


def test_sky_loss_grows_with_opacity_inside_the_sky_only():
    sky = torch.zeros(4, 4, dtype=torch.bool)
    sky[0] = True
    clear, veiled = torch.zeros(4, 4), torch.zeros(4, 4)
    veiled[0] = 0.5
    clear[3] = 1
    assert float(losses.sky_loss(clear, sky)) == pytest.approx(0)
    assert float(losses.sky_loss(veiled, sky)) == pytest.approx(np.log(2) / 4)


def test_psnr_of_a_constant_error():
    image, target = torch.full((8, 8, 3), 0.6), torch.full((8, 8, 3), 0.5)
    assert losses.psnr(image, target, None) == pytest.approx(20.0, abs=1e-3)
