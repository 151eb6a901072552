"""Photos show moving objects at another instant than the LiDAR met them."""

from dataclasses import replace

import numpy as np
import pytest

from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions
from instdrive_core.scene.camera import Camera, CameraView, PhotoLag, look_at
from instdrive_core.scene.pose_transforms import transform_track, transform_view
from instdrive_core.scene.track import Track, find_node_poses, interpolate_tracks

CLOCKWISE = PhotoLag.look_from(np.array([1.0, 2.0, 1.5]), np.radians(-90), -0.1, -0.1, -0.05)
"""Begins behind the car, which looks along y; the photo is taken when the LiDAR looks ahead."""


def track_at(x: float, y: float) -> Track:
    """A car of 10 m/s along y that is at the place at 1 s."""
    poses = np.tile(np.eye(4), (11, 1, 1))
    times = np.linspace(0.5, 1.5, 11)
    poses[:, :3, 3] = np.stack([np.full(11, x), y + 10 * (times - 1), np.full(11, 0.8)], axis=1)
    return Track("car", "Car", np.array([2.0, 4.5, 1.5]), times, poses, moving=True)


@pytest.mark.parametrize(
    ("place", "late"),
    [
        ((1.0, 30.0, 0.0), 0.0),  # ahead: the LiDAR looks there just then
        ((-30.0, 2.0, 0.0), 0.025),  # left: met a quarter turn earlier
        ((30.0, 2.0, 0.0), -0.025),  # right: met a quarter turn later
        ((0.99, -30.0, 0.0), 0.05),  # behind, where the turn began
        ((1.01, -30.0, 0.0), -0.05),  # behind, where it ends
    ],
)
def test_a_photo_lags_by_the_way_that_the_lidar_has_turned(place, late):
    assert CLOCKWISE.find(np.array(place)) == pytest.approx(late, abs=1e-4)


def test_a_lidar_that_turns_the_other_way_meets_the_right_first():
    other = replace(CLOCKWISE, turn=0.1)
    assert other.find(np.array([30.0, 2.0, 0.0])) == pytest.approx(0.025)


def test_a_track_is_shown_later_or_earlier_by_the_side_it_is_on():
    left, right = track_at(-30.0, 2.0), track_at(30.0, 2.0)
    poses = interpolate_tracks([left, right], 1.0, CLOCKWISE)
    np.testing.assert_allclose(poses[:, 1, 3], [2.25, 1.75], atol=1e-3)
    np.testing.assert_array_equal(poses[0], left.interpolate_pose(1.0, CLOCKWISE))
    np.testing.assert_array_equal(find_node_poses([left, right], 1.0, CLOCKWISE)[0][1:], poses)
    np.testing.assert_allclose(interpolate_tracks([left], 1.0)[0, 1, 3], 2.0)


def test_what_a_photo_shows_before_the_first_pose_and_after_the_last_goes_on():
    track = track_at(-30.0, 2.0)
    late, early = CLOCKWISE, replace(CLOCKWISE, taken=-0.1)  # 25 ms later and earlier than the LiDAR
    np.testing.assert_allclose(track.interpolate_pose(1.5, late)[:3, 3], [-30, 7.25, 0.8], atol=0.1)
    np.testing.assert_allclose(track.interpolate_pose(0.5, early)[:3, 3], [-30, -3.25, 0.8], atol=0.1)
    at_end = track.find_shown_time(1.5, late) - 1.5
    np.testing.assert_allclose(track.interpolate_pose(1.5, late)[1, 3], 7 + 10 * at_end)
    single = Track("post", "Car", track.dimensions, track.times[:1], track.world_from_box[:1])
    np.testing.assert_array_equal(single.interpolate_pose(0.5, early), track.world_from_box[0])
    np.testing.assert_array_equal(track.interpolate_pose(1.6), track.world_from_box[-1])


def test_a_scene_that_is_turned_keeps_its_lags():
    camera = replace(Camera(50, 50, 32, 24, 64, 48, look_at(np.zeros(3), np.array([0, 1.0, 0]))), lag=CLOCKWISE)
    turned = matrix_from_quaternion(normalize_quaternions(np.array([0.7, 0.4, -0.2, 0.5])))
    matrix = np.column_stack([2.0 * turned, [5.0, -3.0, 1.0]])
    view = transform_view(CameraView(camera, "front", 0, 1.0), matrix)
    assert view.camera.lag is not None
    for x, y in ((-30.0, 2.0), (12.0, 9.0), (0.0, -20.0)):
        place = track_at(x, y).interpolate_position(1.0)
        moved = transform_track(track_at(x, y), matrix).interpolate_position(1.0)
        assert view.camera.lag.find(moved) == pytest.approx(CLOCKWISE.find(place))
