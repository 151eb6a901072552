"""Spherical harmonics in Numba against the plain ones, and their gradient against differences."""

from __future__ import annotations

import numpy as np
import pytest

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.maths.spherical_harmonics import evaluate_view_colors as plain_view_colors
from instdrive_core.rasterize.kernels.view_colors import build_harmonics_view, compute_colors, compute_colors_backward

POSITION = np.array([0.4, -1.0, 2.0])


def some_harmonics(rest: int, count: int = 300) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(rest)
    shapes = [(count, 3), (count, 3), (count, rest, 3)]
    means, sh_dc, sh_rest = (rng.normal(size=shape).astype(np.float32) for shape in shapes)
    return 5 * means, sh_dc, 0.5 * sh_rest


def some_poses() -> np.ndarray:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1:, :3, :3] = matrix_from_quaternion(np.random.default_rng(0).normal(size=(2, 4)))
    poses[1:, :3, 3] = [[3, 2, 1], [-4, 0, 2]]
    return poses


@pytest.mark.parametrize("rest", REST_COUNTS)
def test_colors_are_those_of_the_plain_formula(rest: int) -> None:
    means, sh_dc, sh_rest = some_harmonics(rest)
    directions = means - POSITION.astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = plain_view_colors(sh_dc, sh_rest, directions)
    found = compute_colors(means, sh_dc, sh_rest, POSITION)
    np.testing.assert_allclose(found, expected, atol=2e-6)
    assert (found == 0).any()


def test_an_actors_colors_turn_with_it() -> None:
    means, sh_dc, sh_rest = some_harmonics(15)
    nodes = (np.arange(300) % 3).astype(np.uint16)
    poses = some_poses()
    found = compute_colors(means, sh_dc, sh_rest, POSITION, nodes, poses)
    for node in range(3):
        rows = nodes == node
        inverse = np.linalg.inv(poses[node])
        local_means = means[rows] @ inverse[:3, :3].T + inverse[:3, 3]
        local_position = inverse[:3, :3] @ POSITION + inverse[:3, 3]
        expected = compute_colors(local_means, sh_dc[rows], sh_rest[rows], local_position)
        np.testing.assert_allclose(found[rows], expected, atol=2e-5)


@pytest.mark.parametrize("rest", REST_COUNTS)
def test_gradients_agree_with_differences(rest: int) -> None:
    means, sh_dc, sh_rest = some_harmonics(rest, 40)
    nodes = (np.arange(40) % 3).astype(np.uint16)
    rng = np.random.default_rng(1)
    grad = rng.normal(size=(40, 3)).astype(np.float32)
    grad[7] = 0
    colors = compute_colors(means, sh_dc, sh_rest, POSITION, nodes, some_poses())
    grad_dc, grad_rest = compute_colors_backward(
        build_harmonics_view(means, POSITION, nodes, some_poses()), rest, colors, grad
    )
    settled = (colors == 0) | (colors > 0.05)  # differences must not cross the clamp
    assert (colors == 0).any()
    for name, gradient in (("dc", grad_dc), ("rest", grad_rest)):
        if gradient.size == 0:
            continue
        step = rng.normal(size=gradient.shape).astype(np.float32) * np.float32(2e-3)
        moved = [
            compute_colors(
                means,
                sh_dc + sign * (step if name == "dc" else 0),
                sh_rest + sign * (step if name == "rest" else 0),
                POSITION,
                nodes,
                some_poses(),
            )
            for sign in (1, -1)
        ]
        numeric = (grad * (moved[0] - moved[1]) / 2)[settled]
        analytic = gradient * step
        analytic = (analytic if name == "dc" else analytic.sum(axis=1))[settled]
        np.testing.assert_allclose(analytic, numeric, atol=2e-6)
    assert not grad_dc[7].any()
    assert not grad_rest[7].any()
