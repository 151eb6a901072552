"""What moves in streets of boxes is found, each object once, where it truly is; what stands is not."""

import numpy as np
import pytest
from box_street import Body, box_clip, jam, walls

from instdrive_core.tracks.finder import find_tracks


def moments(clip, body, track):
    """Metres between a track's centre and a body at the moments that the track's poses hold for."""
    turn = clip.sweeps[1].time - clip.sweeps[0].time
    timed = clip.sweeps[0].load().times is not None
    errors = []
    for time, pose in zip(track.times, track.world_from_box, strict=True):
        ego = next(frame.view.camera.position for frame in clip.frames if frame.view.time == time)
        bearing = np.arctan2(*(np.array(body.pose(time)[:2]) - ego[:2])[::-1])
        lag = turn * ((bearing % (2 * np.pi)) / (2 * np.pi) - 0.5) if timed else 0.0
        errors.append(np.linalg.norm(pose[:2, 3] - body.pose(time + lag)[:2]))
    return np.array(errors)


def track_of(found, clip, body):
    """The only track of a body."""
    near = [track for track in found.tracks if np.median(moments(clip, body, track)) < 1.0]
    assert len(near) == 1, [(track.id, track.times[[0, -1]]) for track in found.tracks]
    return near[0]


def drives(x, y, speed, yaw=0.0):
    return Body(lambda time: (x + speed * time * np.cos(yaw), y + speed * time * np.sin(yaw), yaw))


@pytest.fixture(scope="module")
def traffic():
    bodies = [drives(8, 3.5, 6.0), drives(40, -2.5, -9.0, 0.0), drives(18, 0.0, 3.0)]
    clip = box_clip([*walls(), *bodies], ego=lambda time: 4.0 * time)
    return clip, bodies, find_tracks(clip)


def test_cars_are_found_where_they_are(traffic):
    clip, bodies, found = traffic
    for body in bodies:
        track = track_of(found, clip, body)
        assert len(track.times) >= 18
        assert np.median(moments(clip, body, track)) < 0.25
        assert track.moving


def test_nothing_that_stands_is_found(traffic):
    assert len(traffic[2].tracks) == len(traffic[1])


def test_the_box_stands_on_the_ground_headed_along_its_way(traffic):
    clip, bodies, found = traffic
    track = track_of(found, clip, bodies[0])
    np.testing.assert_allclose(track.dimensions, [1.9, 4.6, 1.6], atol=0.3)
    assert np.abs(track.world_from_box[:, 2, 3] - track.dimensions[2] / 2).max() < 0.2
    forward = track.world_from_box[:, :2, 1]
    assert (forward @ [1, 0] > 0.99).all()


def test_a_street_where_all_stands_has_no_tracks():
    assert not find_tracks(box_clip(walls(), steps=12, ego=lambda time: 6.0 * time)).tracks


def drives_off(time):
    started = max(0.0, time - 0.8)
    return (12 + 1.5 * started**2, 3.2, 0.0)


def stops(time):
    moving = min(time, 1.2)
    return (4 + 5 * moving - 5 / 2.4 * moving**2, -2.8, 0.0)


@pytest.mark.parametrize("pose", [drives_off, stops])
def test_a_car_that_starts_or_stops_is_one_object_all_the_time(pose):
    body = Body(pose)
    clip = box_clip([*walls(), body], steps=22)
    track = track_of(find_tracks(clip), clip, body)
    assert track.times[0] < 0.25
    assert track.times[-1] > 1.95
    assert np.percentile(moments(clip, body, track), 90) < 0.4


def creeps(x, y, phase):
    return Body(lambda time: (x + 1.2 * time + 0.5 * np.sin(2 * time + phase), y, 0.0))


@pytest.mark.parametrize(("period", "timed"), [(0.1, True), (0.2, False)])
def test_a_jam_of_creeping_cars(period, timed):
    bodies = [creeps(9, 0.0, 0.0), creeps(16, 0.0, 1.0), creeps(3, 3.4, 2.0), creeps(10, 3.4, 0.5)]
    clip = box_clip([*walls(), *bodies], round(3.0 / period), period, lambda time: 1.2 * time, timed)
    found = find_tracks(clip)
    for body in (bodies[0], bodies[2])[: 2 if timed else 1]:  # the others hide behind them
        track = track_of(found, clip, body)
        assert np.median(moments(clip, body, track)) < 0.3
    assert len(found.tracks) <= len(bodies)


def test_people_are_found():
    person = Body(lambda time: (9 - 0.3 * time, 6 - 1.4 * time, -np.pi / 2), (0.6, 0.5, 1.7))
    clip = box_clip([*walls(), person], steps=20)
    track = track_of(find_tracks(clip), clip, person)
    assert track.label == "Pedestrian"
    assert np.median(moments(clip, person, track)) < 0.2


def test_gaps_between_sweeps_and_missing_times_are_told_and_survived(traffic):
    from dataclasses import replace

    clip = box_clip([*walls(), drives(8, 3.5, 6.0)], timed=False)
    clip = replace(clip, sweeps=clip.sweeps[:7] + clip.sweeps[9:])
    found = find_tracks(clip)
    assert any("no usable time per point" in note for note in found.notes)
    track_of(found, clip, drives(8, 3.5, 6.0))


def test_too_few_sweeps_are_told():
    from dataclasses import replace

    clip = box_clip(walls(), steps=2)
    assert "too few" in find_tracks(clip).notes[-1]
    assert "no LiDAR sweeps" in find_tracks(replace(clip, sweeps=())).notes[-1]


def test_held_out_sweeps_are_not_used(traffic):
    from dataclasses import replace

    clip, _, found = traffic

    def refuse():
        raise AssertionError("a held-out sweep was read")

    guarded = tuple(replace(one, load=refuse) if one.index % 10 == 4 else one for one in clip.sweeps)
    again = find_tracks(replace(clip, sweeps=guarded))
    assert [track.id for track in again.tracks] == [track.id for track in found.tracks]
    np.testing.assert_array_equal(again.tracks[0].world_from_box, found.tracks[0].world_from_box)


@pytest.fixture(scope="module")
def stop_and_go():
    clip, bodies = jam()
    return clip, bodies, find_tracks(clip)


@pytest.mark.parametrize(("name", "error"), [("ahead", 0.9), ("left", 0.3), ("beside", 2.0), ("drives off", 0.3)])
def test_each_car_of_a_jam_is_one_object(stop_and_go, name, error):
    clip, bodies, found = stop_and_go
    near = [track for track in found.tracks if np.median(moments(clip, bodies[name], track)) < 2.0]
    assert len(near) == 1
    assert near[0].times[-1] - near[0].times[0] > 0.8 * (clip.sweeps[-1].time - clip.sweeps[0].time)
    assert np.median(moments(clip, bodies[name], near[0])) < error


def test_nothing_that_stands_in_a_jam_is_found(stop_and_go):
    assert len(stop_and_go[2].tracks) == len(stop_and_go[1])
