"""k-means within groups against a plain reference."""

import numpy as np

from instdrive_core.baselines.kmeans import find_nearest_centers, move_centers, run_lloyd, seed_centers


def clouds(rng, count=5, each=80):
    middles = rng.uniform(-10, 10, (count, 3)) + 20 * np.arange(count)[:, None]
    which = np.repeat(np.arange(count), each)
    return (middles[which] + rng.normal(0, 0.3, (len(which), 3))).astype(np.float32), which


def test_assignment_is_the_nearest_centre_of_the_own_group():
    rng = np.random.default_rng(0)
    points, centers = rng.normal(size=(300, 4)).astype(np.float32), rng.normal(size=(7, 4)).astype(np.float32)
    starts, groups = np.array([0, 3, 7]), rng.integers(0, 2, 300)
    distances = ((points[:, None] - centers[None]) ** 2).sum(axis=2)
    distances[groups == 0, 3:] = np.inf
    distances[groups == 1, :3] = np.inf
    np.testing.assert_array_equal(find_nearest_centers(points, centers, starts, groups), distances.argmin(axis=1))


def test_a_centre_moves_to_the_mean_of_its_points_and_one_without_stays():
    points = np.array([[0, 0], [2, 0], [5, 5]], np.float32)
    moved = move_centers(points, np.array([0, 0, 2]), np.full((3, 2), 9, np.float32))
    np.testing.assert_allclose(moved, [[1, 0], [9, 9], [5, 5]])


def test_separate_clouds_become_clusters():
    rng = np.random.default_rng(1)
    points, which = clouds(rng)
    centers = seed_centers(points, 5, rng)
    groups = np.zeros(len(points), np.int64)
    owners, centers = run_lloyd(points, centers, np.array([0, 5]), groups, 20)
    assert len(np.unique(np.stack([owners, which]), axis=1).T) == 5
    np.testing.assert_allclose(centers[owners[0]], points[:80].mean(axis=0), atol=1e-4)


def test_seeds_are_distinct_even_where_points_are_few():
    rng = np.random.default_rng(2)
    points = np.repeat(rng.normal(size=(3, 2)), 10, axis=0).astype(np.float32)
    centers = seed_centers(points, 8, rng)
    assert len(centers) == len(np.unique(centers, axis=0)) == 3
