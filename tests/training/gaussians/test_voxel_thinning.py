"""Thinning keeps close to as many points as asked, spread evenly, finer near the drive."""

import numpy as np

from instdrive_core.training.gaussians.voxel_thinning import thin_by_voxels

CENTERS = np.array([[0, 0, 0], [0, 10, 0]], np.float32)


def ground(count, seed=0):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(-40, 40, (count, 2)), np.zeros((count, 1))], axis=1).astype(np.float32)


def thinned(points, limit, seed=1):
    return thin_by_voxels(points, CENTERS, limit, np.random.default_rng(seed))


def test_nearly_as_many_rows_as_asked_for_come_out_in_order():
    rows = thinned(ground(60_000), 6_000)
    assert 0.9 * 6_000 < len(rows) <= 6_000
    assert np.all(np.diff(rows) > 0)
    np.testing.assert_array_equal(rows, thinned(ground(60_000), 6_000))
    assert not np.array_equal(rows, thinned(ground(60_000), 6_000, seed=2))


def test_few_points_all_stay():
    np.testing.assert_array_equal(thinned(ground(50), 50), np.arange(50))


def test_crowds_lose_more_than_lonely_points():
    crowd, lonely = ground(60_000) * 0.02, ground(300, seed=4)
    rows = thinned(np.concatenate([crowd, lonely]), 3_000)
    assert (rows >= len(crowd)).mean() > 0.08
    assert (rows >= len(crowd)).sum() > 200


def test_voxels_grow_with_the_distance():
    points = ground(200_000)
    kept = points[thinned(points, 10_000)]
    distance = np.abs(kept[:, 0])
    near = ((distance < 3) & (kept[:, 1] > 0) & (kept[:, 1] < 10)).sum() / 60
    far = ((distance > 30) & (kept[:, 1] > 0) & (kept[:, 1] < 10)).sum() / 200
    assert near > 8 * far, "points per square metre"


def test_points_of_one_place_become_one():
    points = np.repeat(ground(500), 20, axis=0)
    rows = thinned(points, 2_000)
    assert len(np.unique(rows // 20)) == len(rows)
    assert len(rows) > 490
