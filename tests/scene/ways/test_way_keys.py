"""Keys of ways: few describe a track; they are moved, added, deleted and retimed; speeds are changed."""

import numpy as np
import pytest

from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import PathKey, sample_path, start_at, wait_at
from instdrive_core.scene.ways.speeds import SpeedPoint, drive_at_speeds, list_speed_points, move_point, sample_speeds
from instdrive_core.scene.ways.way_keys import (
    delete_key,
    extend_way,
    find_time_at,
    insert_key,
    move_key,
    retime_key,
    thin_track,
)

STRAIGHT = (PathKey(0.0, 0.0, 0.0), PathKey(10.0, 50.0, 0.0))
"""5 m/s along x."""
BENT = (PathKey(0.0, 0.0, 0.0), PathKey(2.0, 10.0, 0.0), PathKey(4.0, 10.0, 8.0), PathKey(6.0, 10.0, 8.0))


def track_of(keys, step=0.1):
    times = np.arange(keys[0].time, keys[-1].time + step / 2, step)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :2, 3] = sample_path(keys, times).places
    return Track("t", "Car", np.ones(3), times, poses, True)


def x_at(keys, *times):
    return sample_path(keys, np.array(times, float)).places[:, 0]


@pytest.mark.parametrize("keys", [STRAIGHT, BENT])
def test_few_keys_describe_a_track(keys):
    track = track_of(keys)
    found = thin_track(track)
    assert len(found) <= 12
    missed = sample_path(found, track.times).places - track.world_from_box[:, :2, 3]
    assert np.abs(missed).max() <= 0.1
    assert len(thin_track(track_of(STRAIGHT))) == 2


def test_what_stands_has_one_key_with_its_heading():
    standing = track_of((PathKey(0.0, 3.0, 4.0), PathKey(5.0, 3.0, 4.0)))
    (key,) = thin_track(standing)
    assert (key.x, key.y) == (3.0, 4.0)
    assert key.heading == pytest.approx(np.pi / 2), "its box looks along y"


def test_keys_are_moved_retimed_added_and_deleted():
    moved = move_key(BENT, 1, 12.0, -1.0)
    assert (moved[1].x, moved[1].y, moved[1].time) == (12.0, -1.0, 2.0)
    assert retime_key(BENT, 1, 3.0)[1].time == 3.0
    assert retime_key(BENT, 1, 99.0)[1].time < BENT[2].time, "keys keep their order"
    assert retime_key(BENT, 0, 5.0)[0].time < BENT[1].time
    keys, index = insert_key(STRAIGHT, 4.0)
    assert (index, keys[1].x) == (1, pytest.approx(20.0))
    assert insert_key(keys, 4.01) == (keys, 1), "no second key at the same time"
    assert delete_key(keys, 1) == STRAIGHT
    assert delete_key(STRAIGHT[:1], 0) == STRAIGHT[:1]
    assert find_time_at(STRAIGHT, 30.0, 2.0) == pytest.approx((6.0, 2.0), abs=0.2)


def test_own_headings_give_way_to_the_ways():
    headed = tuple(PathKey(key.time, key.x, key.y, 1.0) for key in BENT)
    assert all(key.heading is None for key in move_key(headed, 1, 12.0, 0.0))
    parked = (PathKey(0.0, 1.0, 1.0, 0.5),)
    assert move_key(parked, 0, 2.0, 2.0)[0].heading == 0.5


def test_a_way_goes_on_as_fast_as_before_and_what_stands_starts():
    last = extend_way(STRAIGHT, 60.0, 0.0, 0.0)[-1]
    assert (last.x, last.time) == (60.0, pytest.approx(12.0))
    first, second = extend_way((PathKey(0.0, 0.0, 0.0, 0.3),), 0.0, 10.0, 3.0)
    assert (first.time, second.time) == (3.0, pytest.approx(5.0))
    assert first.heading is None


def test_speeds_are_measured_and_nothing_changes_where_they_do_not():
    speeds = sample_speeds(STRAIGHT, np.array([0.0, 3.0, 10.0, 12.0]))
    np.testing.assert_allclose(speeds, [5, 5, 5, 0], atol=0.01)
    points = list_speed_points(BENT)
    same = drive_at_speeds(BENT, points, points)
    times = np.linspace(0, 6, 30)
    missed = sample_path(same, times).places - sample_path(BENT, times).places
    assert np.abs(missed).max() < 0.25


def test_a_dragged_point_changes_when_not_where():
    points = tuple(SpeedPoint(time, 5.0) for time in (0.0, 2.0, 4.0, 6.0, 10.0))
    slower = move_point(points, 2, 4.0, 1.0)
    keys = drive_at_speeds(STRAIGHT, points, slower)
    assert x_at(keys, 2.0)[0] == pytest.approx(10.0, abs=0.2), "nothing changes before"
    lost = 0.5 * 4.0 * (6.0 - 2.0)
    assert x_at(keys, 10.0)[0] == pytest.approx(50 - lost, abs=0.3)
    assert np.abs(sample_path(keys, np.linspace(0, 10, 50)).places[:, 1]).max() == 0
    stopped = move_point(move_point(points, 2, 4.0, 0.0), 3, 6.0, 0.0)
    keys = drive_at_speeds(STRAIGHT, points, stopped)
    assert np.ptp(x_at(keys, 4.1, 5.0, 5.9)) < 0.06, "it stands between two points at 0"
    fast = tuple(SpeedPoint(point.time, 30.0) for point in points)
    assert x_at(drive_at_speeds(STRAIGHT, points, fast), 9.0)[0] == pytest.approx(50, abs=0.1), "it stays at the end"


def test_points_stay_between_their_neighbours():
    points = tuple(SpeedPoint(time, 5.0) for time in (0.0, 2.0, 4.0))
    assert move_point(points, 1, 9.0, -3.0)[1].speed == 0.0
    assert 2.0 < move_point(points, 1, 9.0, 5.0)[1].time < 4.0
    assert move_point(points, 0, 1.0, 5.0)[0].time == 0.0


def test_waiting_and_starting_later():
    found = x_at(wait_at(STRAIGHT, 2.0, 2.0), 2.0, 4.0, 5.9, 8.0, 10.0)
    np.testing.assert_allclose(found, [10, 15, 15, 20, 30], atol=0.3)
    found = x_at(start_at(STRAIGHT, 3.0), 0.0, 3.0, 5.0, 10.0)
    np.testing.assert_allclose(found, [0, 0, 5, 30], atol=0.3)
