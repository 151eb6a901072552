"""A track ends where its box would slide sideways: there it was mistaken for what is beside it."""

import numpy as np
import pytest

from instdrive_core.tracks.boxes import TrackBox
from instdrive_core.tracks.trajectory import SPACING, Trajectory
from instdrive_core.tracks.written_tracks import find_rolling_span

CAR = TrackBox(np.zeros(2), 4.6, 1.9, 1.5, "Car")
SPEED = 3.0


def drive(yaws, speed=SPEED):
    """Knots of what goes where it points."""
    steps = SPACING * speed * np.column_stack([np.cos(yaws), np.sin(yaws)])
    return np.column_stack([np.cumsum(steps, axis=0), yaws])


def find(knots, box=CAR):
    start, end = find_rolling_span(Trajectory(2.0, knots), box)
    return round((start - 2.0) / SPACING), round((end - 2.0) / SPACING)


def test_what_goes_straight_turns_in_a_narrow_curve_backs_up_or_stands_is_whole():
    for knots in (
        drive(np.zeros(30)),
        drive(np.linspace(0, 1.5, 30)),
        drive(np.full(30, 0.4), -2),
        drive(np.ones(30), 0),
    ):
        assert find(knots) == (0, 29)


def test_noise_of_a_hand_across_does_not_part_it():
    knots = drive(np.zeros(30), 0.5)
    knots[:, 1] += np.random.default_rng(0).normal(0, 0.1, 30)
    assert find(knots) == (0, 29)


@pytest.mark.parametrize("backwards", [False, True])
def test_it_ends_where_it_slides_onto_its_neighbour(backwards):
    knots = drive(np.zeros(30))
    knots[20:, 1] += SPACING * 6 * np.arange(10)
    first, last = find(knots[::-1] if backwards else knots)
    if backwards:
        first, last = 29 - last, 29 - first
    assert first == 0
    assert 17 <= last <= 22


def test_a_box_that_swings_around_a_corner_slides_though_its_origin_stays():
    box = TrackBox(np.array([4.0, 0.0]), 4.6, 1.9, 1.5, "Car")
    knots = drive(np.r_[np.zeros(20), np.linspace(0.1, 1.2, 10)], 0.3)
    first, last = find(knots, box)
    assert first == 0
    assert 17 <= last <= 22


def test_people_step_aside_and_a_heading_that_is_wrong_all_along_says_nothing():
    sideways = drive(np.zeros(30))[:, [1, 0, 2]]
    assert find(sideways, TrackBox(np.zeros(2), 0.6, 0.6, 1.7, "Pedestrian")) == (0, 29)
    assert find(sideways) == (0, 29)
    assert find(sideways[:4]) == (0, 3)
