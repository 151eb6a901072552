"""Which way a road runs is told by its lines, not by who drives on it."""

from dataclasses import replace

import numpy as np
import pytest
from parked_street import CAR, parked_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.holes import build_ground_grid
from instdrive_core.edits.holes.lanes.road_direction import MOST_TURN, turn_to_lines
from instdrive_core.edits.holes.surroundings import find_surroundings


def turn(angle):
    return (float(np.sin(np.radians(angle))), float(np.cos(np.radians(angle))))


def measure_angle(along):
    return np.degrees(np.arctan2(along[0], along[1]))


def make_ground(with_lines=True):
    """A road along y with a white line and a kerb, and shadows across it."""
    rng = np.random.default_rng(3)
    places = rng.uniform([-7, -14], [7, 14], (20000, 2))
    x = places[:, 0]
    heights = np.where((x > 4) & with_lines, 0.1, 0.0) + rng.normal(0, 0.03, len(places))
    brightness = np.where(x > 4, 0.6, 0.4) if with_lines else np.full(len(places), 0.4)
    brightness = np.where((np.abs(x + 2) < 0.08) & with_lines, 0.8, brightness) + rng.normal(0, 0.03, len(places))
    for shadow in rng.uniform([-7, -14], [7, 14], (6, 2)):
        inside = (np.abs(places - shadow) @ np.array([[0.9, -0.4], [0.4, 0.9]]) < [2.5, 1.0]).all(axis=1)
        brightness[inside] *= 0.5
    return places, np.c_[heights, brightness]


@pytest.mark.parametrize("angle", [-4.6, -2.3, 0.0, 1.4, 5.0])
def test_a_drive_that_slants_across_the_road_is_turned_to_its_lines(angle):
    assert measure_angle(turn_to_lines(turn(angle), *make_ground())) == pytest.approx(0, abs=0.3)


def test_shadows_and_noise_turn_nothing():
    assert turn_to_lines(turn(2.0), *make_ground(with_lines=False)) == turn(2.0)


def test_lines_that_cross_the_drive_are_not_its_own():
    angle = 3 * MOST_TURN
    assert turn_to_lines(turn(angle), *make_ground()) == turn(angle)


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_places_have_no_direction(count):
    assert turn_to_lines(turn(1.0), np.zeros((count, 2)), np.zeros((count, 2))) == turn(1.0)


def test_the_map_of_a_hole_lies_along_the_kerb():
    document = Document(parked_street().scene)
    found = find_surroundings(document, [(CAR, document.find_rows((CAR,)))], 0.0)
    grid = build_ground_grid(replace(found, along=turn(2.6)))
    assert measure_angle(grid.along) == pytest.approx(0, abs=0.3)
