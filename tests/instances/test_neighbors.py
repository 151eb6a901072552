"""The forest finds what comparing every pair finds."""

import numba
import numpy as np
import pytest

from instdrive_core.instances.neighbors import build_forest


def compared(points, labels, query, label, count, reach, counts=None):
    """Distances and numbers of the nearest points by brute force, padded with inf and -1."""
    distances = np.linalg.norm(points - query, axis=1)
    may = (labels == label) & (distances <= reach)
    if counts is not None:
        may &= counts
    rows = np.flatnonzero(may)[np.argsort(distances[may], kind="stable")][:count]
    padding = count - len(rows)
    return np.append(distances[rows], [np.inf] * padding), np.append(rows, [-1] * padding)


@pytest.fixture(params=[1, 13, 700, 40_000])
def cloud(request):
    """Points on a plane and around it, with labels of unequal frequency (one of them never occurs)."""
    rng = np.random.default_rng(request.param)
    points = rng.normal(size=(request.param, 3)) * [10, 10, 0.3]
    return points, rng.choice([0, 1, 3], request.param, p=[0.9, 0.08, 0.02])


def test_neighbors_of_other_places(cloud):
    points, labels = cloud
    rng = np.random.default_rng(1)
    queries, asked = rng.normal(size=(60, 3)) * 8, rng.choice(np.unique(labels), 60)
    reach = rng.choice([0.5, 3.0, np.inf], 60)
    ranks, below = rng.integers(0, 4, len(points)), rng.integers(1, 5, 60)
    forest = build_forest(points, labels)
    for extra in ({}, {"ranks": ranks, "below": below}):
        distances, found = forest.find_nearest(queries, asked, 5, reach, **extra)
        for q in range(60):
            counts = ranks < below[q] if extra else None
            expected = compared(points, labels, queries[q], asked[q], 5, reach[q], counts)
            np.testing.assert_allclose(distances[q], expected[0])
            np.testing.assert_array_equal(found[q], expected[1])


def test_neighbors_of_each_point(cloud):
    points, labels = cloud
    distances, found = build_forest(points, labels).find_nearest_to_each(4, np.full(len(points), 2.0))
    np.testing.assert_array_equal(found[:, 0], np.arange(len(points)))
    for row in range(0, len(points), max(1, len(points) // 40)):
        expected = compared(points, labels, points[row], labels[row], 4, 2.0)
        np.testing.assert_allclose(distances[row], expected[0])
        np.testing.assert_array_equal(found[row], expected[1])


def test_points_in_one_place_and_labels_without_points():
    forest = build_forest(np.zeros((500, 3)), np.full(500, 2))
    distances, found = forest.find_nearest(np.zeros((2, 3)), np.array([2, 0]), 3, np.full(2, 1.0))
    assert distances[0].tolist() == [0, 0, 0]
    assert len(set(found[0].tolist())) == 3
    assert found[1].tolist() == [-1, -1, -1]


def test_nothing_at_all():
    distances, _ = build_forest(np.zeros((0, 3)), np.zeros(0, np.int64)).find_nearest_to_each(2, np.zeros(0))
    assert distances.shape == (0, 2)


def test_the_number_of_threads_changes_nothing(cloud):
    points, labels = cloud
    threads = numba.get_num_threads()
    forest = build_forest(points, labels)
    try:
        numba.set_num_threads(1)
        np.testing.assert_array_equal(build_forest(points, labels).rows, forest.rows)
    finally:
        numba.set_num_threads(threads)
