"""What creeps: found whole, and proved by the places that it left."""

import numpy as np
from box_street import along_lane, box_clip, standing, walls

from instdrive_core.tracks.finder import find_things, vote
from instdrive_core.tracks.range_images import build_sweep_image
from instdrive_core.tracks.seen_places import MET, SEEN_THROUGH, UNSEEN, ask_sweep
from instdrive_core.tracks.sweep_clouds import gather_clouds
from instdrive_core.tracks.vacated import vacates

STEPS = 34


def test_a_sweep_tells_what_it_met_what_it_saw_through_and_what_it_could_not_see():
    across, up = np.meshgrid(np.arange(-8, 8, 0.03), np.arange(-2, 3, 0.03))
    wall = np.column_stack([np.full(across.size, 10.0), across.ravel(), up.ravel()]).astype(np.float32)
    image = build_sweep_image(wall, np.zeros(3))
    places = np.array([[10.0, 1.0, 0.5], [6.0, 1.0, 0.5], [14.0, 1.0, 0.5], [-6.0, 1.0, 0.5], [0.0, 0.1, 9.0]])
    assert ask_sweep(places, image).tolist() == [MET, SEEN_THROUGH, UNSEEN, UNSEEN, UNSEEN]


def test_a_sweep_sees_through_a_strip_that_others_leave():
    across, up = np.meshgrid(np.arange(-8, 8, 0.03), np.arange(-2, 3, 0.03))
    wall = np.column_stack([np.full(across.size, 30.0), across.ravel(), up.ravel()]).astype(np.float32)
    roof = wall[wall[:, 2] < -0.1] * np.float32([0.2, 1, 1])  # a car before it hides all but what is over its roof
    image = build_sweep_image(np.concatenate([wall, roof]), np.zeros(3))
    assert ask_sweep(np.array([[15.0, 1.0, 0.02]]), image).tolist() == [SEEN_THROUGH]
    assert ask_sweep(np.array([[15.0, 1.0, -0.3]]), image).tolist() == [UNSEEN]


def creep(time):
    """Metres: 1.3 within 1.2 s, smoothly, then it stands."""
    share = min(max(time / 1.2, 0.0), 1.0)
    return 1.3 * share * share * (3 - 2 * share)


def find(bodies):
    clip = box_clip(bodies, STEPS, ego=lambda time: 0.3 * time, beams=28, azimuths=540)
    clouds, _ = gather_clouds(clip, clip.sweeps)
    return clouds, find_things(clouds, vote(clouds))


def test_a_car_that_creeps_and_stops_is_one_thing_from_the_first_to_the_last_sweep():
    clouds, things = find([*walls(), along_lane(9.0, 3.3, creep)])
    assert len(things) == 1
    thing = things[0]
    assert vacates(thing, clouds)
    assert len(thing.clusters) >= STEPS - 2
    times = np.linspace(0.1, 3.2, 12)
    went = thing.trajectory.poses_at(times)[:, 0] - thing.trajectory.poses_at(times[:1])[0, 0]
    expected = np.array([creep(time) for time in times]) - creep(times[0])
    np.testing.assert_allclose(went, expected, atol=0.15)


def test_sweeps_of_a_bare_plain_have_nothing_that_creeps():
    _, things = find([])
    assert things == []


def test_a_parked_car_that_a_lorry_uncovers_bit_by_bit_stands():
    lorry = along_lane(2.0, 3.4, lambda time: 2.6 * time)
    parked = standing(14.0, 6.6)
    _, things = find([*walls(), parked, type(lorry)(lorry.pose, (2.5, 9.0, 3.2))])
    places = [thing.trajectory.poses_at(np.array([1.2]))[0, :2] for thing in things]
    assert len(things) == 1
    assert np.linalg.norm(places[0] - (14.0, 6.6)) > 2.5
