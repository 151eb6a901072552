"""Depth and sky terms on hand-made cases."""

import numpy as np
import pytest
import torch

from instdrive_core.training import losses


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
