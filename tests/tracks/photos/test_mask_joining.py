"""Masks of one thing are joined: over layers that overlap, and into photos that no corner leads to."""

import numpy as np

from instdrive_core.tracks.photos.layers import join_overlapping
from instdrive_core.tracks.photos.overlap import follow_by_overlap

SIZE = (20, 40)


def box(left, right, top=5, bottom=15):
    inside = np.zeros(SIZE, bool)
    inside[top:bottom, left:right] = True
    return inside


def test_a_door_and_its_car_are_one_thing_and_two_cars_are_two():
    car = {photo: box(10, 20) for photo in range(4)}
    door = {photo: box(12, 15, 8, 12) for photo in range(3)}
    other = {photo: box(19, 30) for photo in range(4)}
    things = join_overlapping([car, door, other])
    assert len(things) == 2
    np.testing.assert_array_equal(things[0][0], car[0])
    assert join_overlapping([]) == []


def test_a_thing_is_followed_to_photos_before_between_and_after():
    maps = [np.where(box(2 * photo, 2 * photo + 8), 3 + photo, 1).astype(np.int32) for photo in range(8)]
    known = follow_by_overlap({2: [5], 3: [6], 5: [8]}, set(), maps)
    assert known == {photo: [3 + photo] for photo in range(8)}


def test_it_is_not_followed_onto_what_belongs_to_something_else_or_is_elsewhere():
    maps = [np.where(box(2, 10), 3, 1).astype(np.int32) for _ in range(4)]
    maps[3] = np.where(box(25, 33), 3, 1).astype(np.int32)
    assert sorted(follow_by_overlap({0: [3]}, {(1, 3)}, maps)) == [0]
    assert sorted(follow_by_overlap({0: [3]}, set(), maps)) == [0, 1, 2]
