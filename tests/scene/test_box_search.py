"""The search over many boxes agrees with the test of one box."""

import numpy as np
import pytest

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.box_search import find_box_of_points
from instdrive_core.scene.track import find_points_inside


def crowded_boxes(count):
    rng = np.random.default_rng(2)
    poses = np.tile(np.eye(4), (count, 1, 1))
    quats = rng.normal(size=(count, 4))
    poses[:, :3, :3] = matrix_from_quaternion(quats / np.linalg.norm(quats, axis=1, keepdims=True))
    poses[:, :3, 3] = rng.uniform(-4, 4, (count, 3))
    return poses, rng.uniform(1, 5, (count, 3))


@pytest.mark.parametrize("grown", [(0.0, None), (0.3, None), (0.2, -0.1)])
def test_the_last_box_that_holds_a_point_is_found(grown):
    poses, dimensions = crowded_boxes(12)
    points = np.random.default_rng(0).uniform(-6, 6, (4000, 3)).astype(np.float32)
    expected = np.full(len(points), -1)
    for number, (pose, size) in enumerate(zip(poses, dimensions, strict=True)):
        expected[find_points_inside(points, pose, size, *grown)] = number
    assert len(np.unique(expected)) > 10
    np.testing.assert_array_equal(find_box_of_points(points, poses, dimensions, *grown), expected)


def test_without_boxes_nothing_is_held():
    points = np.zeros((3, 3), np.float32)
    assert find_box_of_points(points, np.zeros((0, 4, 4)), np.zeros((0, 3))).tolist() == [-1, -1, -1]
