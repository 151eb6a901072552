"""Boxes and hulls find what stands there, whatever floats about it, down to a single Gaussian."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from instdrive_core.instances.oriented_box import (
    MIN_SIZE,
    OrientedBox,
    compute_convex_hull,
    find_main_parts,
    fit_upright_box,
)

CAR = np.array([4.6, 1.8, 1.5])


def turned(points, yaw, center=(0, 0, 0)):
    cos, sin = math.cos(yaw), math.sin(yaw)
    return points @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).T + center


def car(rng, count, yaw=0.0, center=(0, 0, 0)):
    """Places on the faces of a car's box."""
    places = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    places[np.arange(count), axis] = np.sign(places[np.arange(count), axis]) / 2
    return turned(places * CAR, yaw, center)


def small(count, sigma=0.02):
    return np.broadcast_to(np.eye(3) * sigma**2, (count, 3, 3))


def angle_between(one, other):
    """Angle between two axes without direction, in radians."""
    return abs((one - other + math.pi / 2) % math.pi - math.pi / 2)


@settings(max_examples=25, deadline=None)
@given(yaw=st.floats(-math.pi, math.pi), seed=st.integers(0, 1000), x=st.floats(-200, 200))
def test_a_car_is_found_among_floaters(yaw, seed, x):
    rng = np.random.default_rng(seed)
    center = np.array([x, -40.0, 1.0])
    away = rng.normal(size=(40, 3))
    floaters = center + away / np.linalg.norm(away, axis=1, keepdims=True) * rng.uniform(6, 60, (40, 1))
    means = np.concatenate([car(rng, 1500, yaw, center), floaters])
    kept = find_main_parts(means)
    assert kept[:1500].all()
    assert not kept[1500:].any()
    box = fit_upright_box(means[kept], small(kept.sum()))
    np.testing.assert_allclose(box.center, center, atol=0.1)
    np.testing.assert_allclose(box.size, CAR, atol=0.15)
    assert angle_between(box.yaw, yaw) < math.radians(2)
    assert -math.pi / 2 < box.yaw <= math.pi / 2
    assert box.holds(means[:1500], 0.15).all()


def test_a_given_yaw_is_kept_and_measured_along():
    means = car(np.random.default_rng(0), 2000, 0.4)
    assert fit_upright_box(means, small(2000), 0.4 + math.pi / 2).size[1] == pytest.approx(CAR[0], abs=0.1)
    assert fit_upright_box(means, small(2000), 0.4).yaw == 0.4


def test_gaussians_reach_beyond_their_means():
    box = fit_upright_box(np.zeros((1, 3)), np.diag([4.0, 0.25, 0.01])[None])
    np.testing.assert_allclose(box.size, [4, 1, 0.2])
    assert box.yaw == 0


def test_a_long_splat_lies_along_its_own_direction():
    spread = turned(np.eye(3), 0.7).T
    covariance = spread @ np.diag([4.0, 0.01, 0.01]) @ spread.T
    box = fit_upright_box(np.array([[5.0, 6, 7]]), covariance[None])
    assert angle_between(box.yaw, 0.7) < math.radians(0.1)
    np.testing.assert_allclose(box.size, [4, 0.2, 0.2], atol=0.01)


@pytest.mark.parametrize(
    "means",
    [
        np.zeros((1, 3)),
        np.zeros((7, 3)),
        np.array([[0.0, 0, 0], [3, 4, 0]]),
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 2]]),
        np.random.default_rng(0).uniform(0, 1, (50, 3)) * [3, 2, 0],
        np.linspace(0, 1, 30)[:, None] * [1.0, 1, 1],
        np.array([[0.0, 0, 0], [1e30, 0, 0], [0, 1, 0]]),
    ],
    ids=["one", "one place", "two", "three", "flat", "line", "far"],
)
def test_degenerate_instances_have_a_box(means):
    kept = find_main_parts(means)
    assert kept.any()
    box = fit_upright_box(means[kept], np.zeros((kept.sum(), 3, 3)))
    assert np.isfinite(box.size).all()
    assert (box.size >= MIN_SIZE).all()
    assert box.holds(means[kept], 0.1 * float(box.size.max())).mean() >= 0.9
    if np.linalg.matrix_rank(means[kept] - means[kept][0]) < 3:
        assert compute_convex_hull(means[kept]) is None


def test_two_corners_lie_along_the_box():
    box = fit_upright_box(np.array([[0.0, 0, 0], [3, 4, 0]]), np.zeros((2, 3, 3)))
    assert box.size[0] == pytest.approx(5, abs=0.01)
    assert angle_between(box.yaw, math.atan2(4, 3)) < math.radians(0.1)


def test_few_sparse_gaussians_are_no_floaters():
    rng = np.random.default_rng(1)
    assert find_main_parts(rng.uniform(-2, 2, (12, 3))).sum() >= 10
    assert find_main_parts(np.array([[0.0, 0, 0], [10, 0, 0], [0, 7, 0]])).all()


def test_the_hull_is_closed_and_faces_outward():
    rng = np.random.default_rng(2)
    points = rng.normal((1000, 2000, 0), 1, (400, 3))
    vertices, faces = compute_convex_hull(points)
    sides = vertices[faces]
    center = points.mean(axis=0)
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    assert (np.einsum("fi,fi->f", normals, sides.mean(axis=1) - center) > 0).all()
    volume = np.einsum("fi,fi->", np.cross(sides[:, 0] - center, sides[:, 1] - center), sides[:, 2] - center) / 6
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert volume > 0
    assert len(vertices) < 400


def test_box_axes_and_points():
    box = OrientedBox(np.array([1.0, 2, 3]), np.array([4.0, 2, 1]), math.pi / 2)
    np.testing.assert_allclose(box.rotation[:, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(box.holds(np.array([[1.0, 3.9, 3], [2.9, 2, 3], [1, 2, 3.6]])), [True, False, False])
