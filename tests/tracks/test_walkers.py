"""People who walk side by side are as many tracks as people."""

import numpy as np
import pytest
from box_street import Body, box_clip, walls

from instdrive_core.tracks.abreast import part_abreast
from instdrive_core.tracks.finder import find_things, vote
from instdrive_core.tracks.sweep_clouds import gather_clouds


def cross(x, y, height=1.7):
    """Somebody who crosses the street."""
    return Body(lambda time: (x, y + 1.3 * time, np.pi / 2), (0.5, 0.5, height))


def find(*bodies):
    """Things of a street, with clouds and votes."""
    clip = box_clip([*walls(), *bodies], 22, beams=40, azimuths=1080)
    clouds, _ = gather_clouds(clip, clip.sweeps)
    votes = vote(clouds)
    return find_things(clouds, votes), clouds, votes


def list_places(things):
    """Where things are across the street after a second, in metres."""
    boxes = [(thing.trajectory.poses_at(np.array([1.0]))[0], thing.lasting_points()) for thing in things]
    turned = [
        (pose, (local[:, 0] * np.sin(pose[2]) + local[:, 1] * np.cos(pose[2])).mean() + pose[1])
        for pose, local in boxes
    ]
    return sorted(float(place) for _, place in turned)


@pytest.mark.parametrize("apart", [1.1, 0.75])
def test_two_who_walk_side_by_side_are_two(apart):
    things, _, _ = find(cross(11.0, -3.0), cross(11.1, -3.0 + apart))
    np.testing.assert_allclose(list_places(things), [-1.7, -1.7 + apart], atol=0.3)


def test_a_cart_beside_somebody_is_no_second_person():
    things, _, _ = find(cross(11.0, -3.0), cross(11.0, -2.25, 0.95))
    assert len(things) == 1


def test_somebody_alone_is_not_parted():
    (thing,), clouds, votes = find(cross(11.0, -3.0))
    assert part_abreast(thing, clouds, votes) == [thing]
