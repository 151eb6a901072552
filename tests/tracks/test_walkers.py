"""People who walk side by side are as many tracks as people."""

import numpy as np
from box_street import Body, box_clip, walls

from instdrive_core.tracks.finder import find_things, vote
from instdrive_core.tracks.sweep_clouds import gather_clouds


def cross(x, y):
    """Somebody who crosses the street."""
    return Body(lambda time: (x, y + 1.3 * time, np.pi / 2), (0.5, 0.5, 1.7))


def test_two_who_walk_side_by_side_are_two():
    clip = box_clip([*walls(), cross(11.0, -3.0), cross(11.1, -1.9)], 22, beams=40, azimuths=1080)
    clouds, _ = gather_clouds(clip, clip.sweeps)
    things = find_things(clouds, vote(clouds))
    places = sorted(float(thing.trajectory.poses_at(np.array([1.0]))[0, 1]) for thing in things)
    np.testing.assert_allclose(places, [-1.7, -0.6], atol=0.4)
