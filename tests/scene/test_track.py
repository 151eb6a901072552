import numpy as np
import pytest
from random_scene import random_track

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.track import find_node_poses, find_points_inside, interpolate_tracks


@pytest.fixture
def track():
    return random_track(np.random.default_rng(0), "a")


def test_poses_at_and_between_steps(track):
    np.testing.assert_allclose(track.interpolate_pose(0.2), track.world_from_box[2], atol=1e-9)
    middle = track.interpolate_pose(0.25)
    np.testing.assert_allclose(middle[:3, 3], track.world_from_box[2:4, :3, 3].mean(axis=0))
    np.testing.assert_allclose(middle[:3, :3] @ middle[:3, :3].T, np.eye(3), atol=1e-9)


def test_outside_its_time_the_track_stands_still_and_is_not_covered(track):
    np.testing.assert_array_equal(track.interpolate_pose(-5.0), track.world_from_box[0])
    np.testing.assert_array_equal(track.interpolate_pose(99.0), track.world_from_box[-1])
    assert track.covers(-0.05)
    assert track.covers(0.45)
    assert not track.covers(-0.1)
    assert not track.covers(0.5)


def test_many_times_and_many_tracks_at_once_give_each_pose_to_the_bit(track):
    times = np.array([-5.0, 0.0, 0.07, 0.2, 0.2500001, 0.39, 99.0])
    alone = np.array([track.interpolate_pose(time) for time in times])
    np.testing.assert_array_equal(track.interpolate_poses(times), alone)
    tracks = [random_track(np.random.default_rng(seed), str(seed)) for seed in range(5)]
    for time in times:
        together = interpolate_tracks(tracks, time)
        np.testing.assert_array_equal(together, [each.interpolate_pose(time) for each in tracks])
        poses, present = find_node_poses(tracks, time)
        np.testing.assert_array_equal(poses, [np.eye(4), *together])
        assert present.tolist() == [1, *(each.covers(time) for each in tracks)]
    assert interpolate_tracks([], 0.0).shape == (0, 4, 4)


def test_path_length(track):
    steps = np.linalg.norm(np.diff(track.world_from_box[:, :3, 3], axis=0), axis=1)
    assert track.compute_path_length() == pytest.approx(steps.sum())


def test_points_inside_a_turned_box():
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_quaternion(np.array([np.cos(0.4), 0, 0, np.sin(0.4)]))
    pose[:3, 3] = [10, -4, 1]
    local = np.array([[0.9, 1.9, 0.4], [1.1, 0, 0], [0, 0, -0.55], [0, 0, -0.45], [0, 0, 0.55]])
    world = local @ pose[:3, :3].T + pose[:3, 3]
    size = np.array([2.0, 4.0, 1.0])
    np.testing.assert_array_equal(find_points_inside(world, pose, size), [True, False, False, True, False])
    np.testing.assert_array_equal(find_points_inside(world, pose, size, 0.2), [True] * 5)
    np.testing.assert_array_equal(find_points_inside(world, pose, size, 0.2, -0.1), [True, True, False, False, True])
