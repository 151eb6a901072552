"""Depth and sky terms on hand-made cases, and against plain torch."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy import ndarray
from torch import Tensor

from instdrive_core.training.backends.losses import depth_loss, opacity_loss

SHAPE = (13, 9)


def some_depths() -> tuple[Tensor, Tensor, ndarray, ndarray]:
    rng = np.random.default_rng(0)
    alpha = torch.tensor(rng.uniform(0, 1, SHAPE), dtype=torch.float32)
    alpha[alpha < 0.2] *= 0.2  # some below the limit
    depth = torch.tensor(rng.uniform(1, 60, SHAPE), dtype=torch.float32)
    pixels = np.sort(rng.choice(alpha.numel(), 50, replace=False)).astype(np.int32)
    lidar_depths = rng.uniform(1, 60, 50).astype(np.float32)
    return depth.requires_grad_(True), alpha.requires_grad_(True), pixels, lidar_depths


def plain_depth_loss(depth: Tensor, alpha: Tensor, pixels: ndarray, lidar_depths: ndarray) -> Tensor:
    where = torch.from_numpy(pixels.astype(np.int64))
    drawn, opacity = depth.flatten()[where], alpha.flatten()[where]
    counts = opacity > 0.05
    return (drawn[counts] / opacity[counts] - torch.from_numpy(lidar_depths)[counts]).abs().mean()


def plain_opacity_loss(alpha: Tensor, pixels: ndarray, solid: bool) -> Tensor:
    right = alpha if solid else 1 - alpha
    return -torch.log(right[torch.from_numpy(pixels)].clamp_min(1e-4)).sum() / alpha.numel()


def test_depth_loss_is_metres_where_lidar_knows() -> None:
    depth, alpha = torch.full((2, 2), 4.5), torch.full((2, 2), 0.5)
    assert float(depth_loss(depth, alpha, np.array([0, 3]), np.array([10.0, 8.0]))) == pytest.approx(1.0)


def test_depth_loss_without_depths_is_0_and_has_no_gradient() -> None:
    depth, alpha, pixels, lidar_depths = some_depths()
    loss = depth_loss(depth, alpha, pixels[:0], lidar_depths[:0])
    grads = torch.autograd.grad(loss, (depth, alpha))
    assert float(loss.detach()) == 0
    assert not any(grad.any() for grad in grads)
    unseen = torch.full(SHAPE, 0.04, requires_grad=True)
    loss = depth_loss(depth, unseen, pixels, lidar_depths)
    assert float(loss.detach()) == 0
    assert not torch.autograd.grad(loss, depth)[0].any()


@pytest.mark.parametrize("kinds", [(np.int32, np.float32), (np.int64, np.float64)])
def test_depth_loss_and_gradients_are_those_of_plain_torch(kinds: tuple[type, type]) -> None:
    depth, alpha, pixels, lidar_depths = some_depths()
    loss = depth_loss(depth, alpha, pixels.astype(kinds[0]), lidar_depths.astype(kinds[1]))
    expected = plain_depth_loss(depth, alpha, pixels, lidar_depths)
    assert float(loss.detach()) == pytest.approx(float(expected.detach()), rel=1e-5)
    found = torch.autograd.grad(2.5 * loss, (depth, alpha))
    for grad, wanted in zip(found, torch.autograd.grad(2.5 * expected, (depth, alpha)), strict=True):
        np.testing.assert_allclose(grad, wanted, rtol=1e-4, atol=1e-6)


def test_a_pixel_named_twice_counts_twice() -> None:
    depth = torch.full((2, 2), 4.0, requires_grad=True)
    loss = depth_loss(depth, torch.full((2, 2), 0.5), np.array([1, 1, 2]), np.array([5.0, 5.0, 14.0]))
    loss.backward()
    np.testing.assert_allclose(depth.grad, [[0, 4 / 3], [-2 / 3, 0]], rtol=1e-6)


def test_opacity_loss_grows_with_opacity_inside_the_sky_only() -> None:
    sky = np.zeros((4, 4), bool)
    sky[0] = True
    clear, veiled = torch.zeros(4, 4), torch.zeros(4, 4)
    veiled[0] = 0.5
    clear[3] = 1
    assert float(opacity_loss(clear, sky, solid=False)) == pytest.approx(0)
    assert float(opacity_loss(veiled, sky, solid=False)) == pytest.approx(np.log(2) / 4)


@pytest.mark.parametrize("solid", [False, True])
def test_opacity_loss_and_gradient_are_those_of_plain_torch(solid: bool) -> None:
    rng = np.random.default_rng(1)
    values = rng.uniform(0, 1, (6, 300))
    values[0], values[1, :200] = 1, 0.9999999  # hidden skies: the logarithm stays finite
    values[2], values[3, :200] = 0, 1e-7
    alpha = torch.tensor(values, dtype=torch.float32, requires_grad=True)
    pixels = rng.random((6, 300)) < 0.7
    loss, expected = opacity_loss(alpha, pixels, solid), plain_opacity_loss(alpha, pixels, solid)
    assert float(loss.detach()) == pytest.approx(float(expected.detach()), rel=1e-5)
    (found,), (wanted,) = torch.autograd.grad(2 * loss, alpha), torch.autograd.grad(2 * expected, alpha)
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    assert float(opacity_loss(alpha, np.zeros((6, 300), bool), solid).detach()) == 0
