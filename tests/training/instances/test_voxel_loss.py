"""The voxel loss against hand-made cases, its printed form and finite differences."""

import numba
import numpy as np
import pytest
import torch

from instdrive_core.training.instances.voxel_loss import voxel_loss
from instdrive_core.training.instances.voxels import Voxels, group_by_voxel


def test_loss_is_the_mean_spread_over_voxels():
    features = torch.tensor([[0.0], [2.0], [5.0]])
    voxels = Voxels(np.array([0, 1, 2]), np.array([0, 2, 3]))
    assert voxel_loss(features, voxels)[0] == pytest.approx(0.5)
    assert voxel_loss(features, voxels, weight=3.0)[0] == pytest.approx(1.5)


@pytest.mark.parametrize("tanh", [False, True])
def test_loss_and_gradient_are_those_of_the_printed_form(tanh):
    rng = np.random.default_rng(0)
    owner = np.sort(rng.integers(0, 900, 2_000))
    order = rng.permutation(2_000)
    starts = np.flatnonzero(np.diff(owner, prepend=-1))
    features = torch.from_numpy(rng.normal(0, 2, size=(2_000, 16))).float()  # some where tanh is flat
    loss, gradient = voxel_loss(features, Voxels(order, np.append(starts, 2_000)), 0.3, tanh)
    exact = features.double().requires_grad_(True)
    values = (torch.tanh(exact) if tanh else exact)[order]
    expected = torch.stack(
        [(g - g.mean(dim=0)).square().sum(dim=1).mean() for g in values.tensor_split(starts[1:].tolist())]
    )
    expected = 0.3 * expected.mean()
    expected.backward()
    assert loss == pytest.approx(float(expected.detach()), rel=1e-6)
    np.testing.assert_allclose(gradient, exact.grad, atol=1e-9, rtol=1e-4)


@pytest.mark.parametrize("tanh", [False, True])
def test_gradient_is_that_of_finite_differences(tanh):
    rng = np.random.default_rng(0)
    features = torch.from_numpy(rng.normal(size=(9, 3)))
    voxels = Voxels(rng.permutation(9), np.array([0, 4, 5, 9]))
    _, gradient = voxel_loss(features, voxels, 3.0, tanh)
    for row, column in np.ndindex(9, 3):
        step = torch.zeros(9, 3, dtype=torch.float64)
        step[row, column] = 1e-5
        difference = (
            voxel_loss(features + step, voxels, 3.0, tanh)[0] - voxel_loss(features - step, voxels, 3.0, tanh)[0]
        )
        assert float(gradient[row, column]) == pytest.approx(difference / 2e-5, abs=1e-8 if not tanh else 1e-5)


def test_bits_are_the_same_with_any_number_of_threads():
    rng = np.random.default_rng(0)
    positions = rng.normal(0, 9, (20_000, 3)).astype(np.float32)
    voxels = group_by_voxel(positions, np.zeros(20_000, np.uint16), 0.5, np.zeros(3))
    features = torch.from_numpy(rng.normal(size=(20_000, 16))).float()
    results = []
    threads = numba.get_num_threads()
    for number in (1, threads):
        numba.set_num_threads(number)
        results.append(voxel_loss(features, voxels))
    assert results[0][0] == results[1][0]
    assert torch.equal(results[0][1], results[1][1])


def test_a_feature_that_is_no_number_shows_in_the_loss():
    features = torch.zeros(4, 3)
    features[2, 1] = float("nan")
    loss, _ = voxel_loss(features, Voxels(np.arange(4), np.array([0, 4])), tanh=True)
    assert np.isnan(loss)


def test_no_gaussians_cost_nothing():
    voxels = group_by_voxel(np.zeros((0, 3), np.float32), np.zeros(0, np.uint16), 0.5, np.zeros(3))
    loss, gradient = voxel_loss(torch.zeros(0, 4), voxels)
    assert loss == 0
    assert gradient.shape == (0, 4)
