"""The voxel loss against hand-made cases and finite differences."""

import numpy as np
import pytest
import torch

from instdrive_core.training.voxel_loss import Voxels, occupied_voxels, voxel_loss


def voxel_of_each(voxels: Voxels) -> list[int]:
    owner = np.empty(len(voxels.order), int)
    for number, (start, stop) in enumerate(zip(voxels.starts[:-1], voxels.starts[1:], strict=True)):
        owner[voxels.order[start:stop]] = number
    return owner.tolist()


def test_voxels_never_join_nodes_and_follow_the_offset():
    positions = np.array([[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [0.2, 0.1, 0.1], [0.6, 0.1, 0.1]], np.float32)
    nodes = np.array([0, 0, 1, 0], np.uint16)
    still = voxel_of_each(occupied_voxels(positions, nodes, 0.5, np.zeros(3)))
    assert still[0] == still[1]
    assert still[2] not in (still[0], still[3])
    assert still[3] != still[0]
    shifted = voxel_of_each(occupied_voxels(positions, nodes, 0.5, np.array([0.35, 0, 0])))
    assert shifted[3] == shifted[1] != shifted[0]


def test_loss_is_the_mean_spread_over_voxels():
    features = torch.tensor([[0.0], [2.0], [5.0]])
    assert float(voxel_loss(features, Voxels(np.array([0, 1, 2]), np.array([0, 2, 3])))) == pytest.approx(0.5)


def test_gradient_is_that_of_finite_differences():
    rng = np.random.default_rng(0)
    features = torch.from_numpy(rng.normal(size=(9, 3))).requires_grad_(True)
    voxels = Voxels(rng.permutation(9), np.array([0, 4, 5, 9]))
    assert torch.autograd.gradcheck(lambda f: voxel_loss(f, voxels) * 3, features)


def test_no_gaussians_cost_nothing():
    voxels = occupied_voxels(np.zeros((0, 3), np.float32), np.zeros(0, np.uint16), 0.5, np.zeros(3))
    assert float(voxel_loss(torch.zeros(0, 4), voxels)) == 0
