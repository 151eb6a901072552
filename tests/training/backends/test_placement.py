"""Actors carried into the world: values as the scene places them, gradients along every curve of poses."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy import ndarray
from torch import Tensor

from instdrive_core.maths.rotations import (
    matrix_from_quaternion,
    multiply_quaternions,
    normalize_quaternions,
    quaternion_from_matrix,
)
from instdrive_core.scene.scene import place_in_world
from instdrive_core.training.backends.placement import place_gaussians

NODES = np.repeat(np.arange(6), [700, 900, 0, 1, 800, 40]).astype(np.uint16)
"""Node 2 has no rows; chunks of the kernel begin and end inside nodes."""


def some_splats() -> tuple[Tensor, Tensor]:
    rng = np.random.default_rng(0)
    arrays = 3 * rng.normal(size=(len(NODES), 3)), rng.normal(size=(len(NODES), 4))
    means, quats = (torch.tensor(array, dtype=torch.float32, requires_grad=True) for array in arrays)
    return means, quats


def some_poses(seed: int = 1) -> tuple[ndarray, ndarray]:
    rng = np.random.default_rng(seed)
    rotations, shifts = matrix_from_quaternion(rng.normal(size=(6, 4))), rng.normal(size=(6, 3))
    rotations[0], shifts[0] = np.eye(3), 0
    return rotations, shifts


def tensors(*arrays: ndarray) -> list[Tensor]:
    return [torch.tensor(array, dtype=torch.float32, requires_grad=True) for array in arrays]


def test_values_are_those_of_the_scene() -> None:
    (means, quats), (rotations, shifts) = some_splats(), some_poses()
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotations, shifts
    found_means, found_quats = (
        t.detach().numpy() for t in place_gaussians(means, quats, NODES, *tensors(rotations, shifts))
    )
    expected_means, expected_quats = place_in_world(means.detach().numpy(), quats.detach().numpy(), NODES, poses)
    np.testing.assert_allclose(found_means, expected_means, atol=1e-5)
    np.testing.assert_allclose(normalize_quaternions(found_quats), normalize_quaternions(expected_quats), atol=1e-5)
    first = np.searchsorted(NODES, 1)
    np.testing.assert_array_equal(found_means[:first], means.detach().numpy()[:first])
    np.testing.assert_array_equal(found_quats[:first], quats.detach().numpy()[:first])


def weighted_sum(weights: tuple[Tensor, Tensor], placed_splats: tuple[Tensor, Tensor]) -> Tensor:
    return sum(((w * value).sum() for w, value in zip(weights, placed_splats, strict=True)), torch.zeros(()))


def some_weights() -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(3)
    count = len(NODES)
    return torch.randn(count, 3, generator=generator), torch.randn(count, 4, generator=generator)


def test_gradients_of_rows_are_those_of_plain_torch() -> None:
    (means, quats), (rotations, shifts), weights = some_splats(), some_poses(), some_weights()
    loss = weighted_sum(weights, place_gaussians(means, quats, NODES, *tensors(rotations, shifts)))
    by_means, by_quats = torch.autograd.grad(loss, (means, quats))
    expected_means = np.einsum("nij,ni->nj", rotations[NODES], weights[0].numpy())
    conjugates = quaternion_from_matrix(rotations)[NODES] * [1, -1, -1, -1]
    np.testing.assert_allclose(by_means, expected_means, atol=1e-5)
    np.testing.assert_allclose(by_quats, multiply_quaternions(conjugates, weights[1].numpy()), atol=1e-5)


def placed_in_double(means: ndarray, quats: ndarray, rotations: ndarray, shifts: ndarray) -> tuple[ndarray, ndarray]:
    moved = np.einsum("nij,nj->ni", rotations[NODES], means) + shifts[NODES]
    return moved, multiply_quaternions(quaternion_from_matrix(rotations)[NODES], quats)


@pytest.mark.parametrize("parts", [(1, 0), (0, 1), (1, 1)], ids=["means", "quats", "both"])
def test_gradients_of_poses_are_those_of_differences_along_turns(parts: tuple[int, int]) -> None:
    (means, quats), (rotations, shifts) = some_splats(), some_poses()
    weights = tuple(part * weight for part, weight in zip(parts, some_weights(), strict=True))
    pose_tensors = tensors(rotations, shifts)
    loss = weighted_sum(weights, place_gaussians(means, quats, NODES, *pose_tensors))
    by_rotations, by_shifts = torch.autograd.grad(loss, pose_tensors)
    arrays, step = [t.detach().numpy().astype(np.float64) for t in (means, quats)], 1e-5
    for node in (1, 3, 4, 5):
        for axis in range(3):
            turn = np.zeros(3)
            turn[axis] = step
            values = []
            for sign in (1, -1):
                half = matrix_from_quaternion(np.concatenate([[1.0], sign * turn / 2]))
                moved = rotations.copy()
                moved[node] = rotations[node] @ half
                results = placed_in_double(*arrays, moved, shifts)
                values.append(sum(float((w.numpy() * r).sum()) for w, r in zip(weights, results, strict=True)))
            cross = np.cross(np.eye(3)[axis], np.eye(3)).T  # [e]×
            analytic = float((by_rotations[node].numpy() * (rotations[node] @ cross)).sum())
            assert analytic == pytest.approx((values[0] - values[1]) / (2 * step), rel=1e-3, abs=2e-2)
    expected_shifts = np.stack([weights[0].numpy()[node == NODES].sum(axis=0) for node in range(6)])
    np.testing.assert_allclose(by_shifts[1:], expected_shifts[1:], rtol=1e-4, atol=1e-3)
    assert not by_rotations[[0, 2]].any()
    assert not by_shifts[[0, 2]].any()


def test_a_scene_without_actors_comes_back_as_it_is() -> None:
    means, quats = some_splats()
    found = place_gaussians(means, quats, np.zeros(len(means), np.uint16), *tensors(*some_poses()))
    assert found[0] is means
    assert found[1] is quats


def test_rows_out_of_order_are_refused() -> None:
    means, quats = some_splats()
    with pytest.raises(ValueError, match="ordered"):
        place_gaussians(means, quats, NODES[::-1].copy(), *tensors(*some_poses()))
    with pytest.raises(ValueError, match="node 5"):
        place_gaussians(means, quats, NODES, *(t[:4] for t in tensors(*some_poses())))
