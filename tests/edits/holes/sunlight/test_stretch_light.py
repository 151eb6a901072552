"""Where the sun stands, and which hidden ground lies in the shade, is told by the ground that photos show."""

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR
from random_scene import assert_same_scene
from sunny_street import CAR_HALF, CAR_PLACE, DIMMED, OTHER_PLACE, SUN, find_shaded, sunny_street

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_map import GroundMap
from instdrive_core.edits.holes.sunlight import stretch_light
from instdrive_core.edits.holes.sunlight.street_light import correlate
from instdrive_core.edits.holes.sunlight.stretch_light import find_hole_light
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.maths.spherical_harmonics import color_from_dc


@pytest.fixture(scope="module")
def scene():
    return sunny_street()


def look_under_car(scene, gone=True):
    """The light on the ground around the car, and the places of its cells."""
    document = Document(deepcopy(scene))
    rows = document.find_rows((CAR,))
    shape = (40, 20)
    grid = GroundGrid((CAR_PLACE[0] + 2.0, CAR_PLACE[1] - 4.0), (0.0, 1.0), 0.2, shape, (0.0, 0.0, 0.0))
    places = grid.compute_centers(grid.list_cells())
    hole = (np.abs(places - CAR_PLACE[:2]) < CAR_HALF[:2]).all(axis=1).reshape(shape)
    nothing = np.zeros(shape, bool)
    color = np.full((*shape, 3), 0.45)
    ground = GroundMap(grid, np.ones(shape), color, np.zeros(shape), nothing, np.zeros(0, bool))
    light = find_hole_light(document, ground, ~hole, hole, None, rows if gone else rows[:0])
    return light, places, hole


def test_the_shade_below_a_car_is_that_of_houses_whose_roofs_no_photo_shows(scene):
    light, places, hole = look_under_car(scene)
    truth = find_shaded(places, (OTHER_PLACE,)).reshape(hole.shape)[hole]
    assert 0.1 < truth.mean() < 0.9, "the edge of the shade lies below the car"
    told = light.shaded[hole] > 0.5
    assert (told == truth).mean() > 0.85
    assert light.dimming[hole] == pytest.approx(np.full((hole.sum(), 3), DIMMED), abs=0.05)


def test_what_still_stands_there_throws_its_shadow(scene):
    with_car, without = look_under_car(scene, gone=False)[0], look_under_car(scene)[0]
    assert (with_car.shaded > 0.5).mean() > (without.shaded > 0.5).mean() + 0.05


def test_the_sun_is_found_in_the_direction_in_which_it_stands(scene):
    stretch_light._kept.clear()
    look_under_car(scene)
    (stretch,) = stretch_light._kept.values()
    sun, grid = stretch.light.sun, stretch.light.rows.grid
    across = np.array(sun.toward) @ grid.axes
    level = SUN[:2] / np.linalg.norm(SUN[:2])
    assert across @ level > np.cos(np.radians(12))


def test_under_clouds_nothing_is_told():
    assert look_under_car(sunny_street(shade=False))[0] is None


def test_without_photos_nothing_is_told(scene):
    blind = deepcopy(scene)
    blind.views = ()
    assert look_under_car(blind)[0] is None


def test_the_fill_has_the_shade_and_is_the_same_again(scene):
    scenes = []
    for _ in range(2):
        document = Document(deepcopy(scene))
        document.apply(DeleteInstances((CAR,)))
        document.apply(report_deletion(document, (CAR,), 0.0).make_fill_edits()[0])
        scenes.append(document.scene)
    assert_same_scene(*scenes)
    added = slice(len(scene), None)
    means, colors = scenes[0].gaussians.means[added], color_from_dc(scenes[0].gaussians.sh_dc[added]).mean(axis=1)
    ground = (np.abs(means[:, :2] - CAR_PLACE[:2]) < CAR_HALF[:2] - 0.2).all(axis=1) & (np.abs(means[:, 2]) < 0.1)
    dark = colors[ground] < 0.3
    assert 0.1 < dark.mean() < 0.9
    assert correlate(dark, find_shaded(means[ground][:, :2], (OTHER_PLACE,))) > 0.6
