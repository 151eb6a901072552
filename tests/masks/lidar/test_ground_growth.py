"""Ground among rows of cars, on hills, and where little of it is seen."""

from __future__ import annotations

import numpy as np
import pytest

from instdrive_core.masks.lidar.ground import CELL, find_ground
from instdrive_core.masks.lidar.ground_growth import drape_surface, select_connected

GRADE = 0.04
ROWS = (-10.0, -6.8, -3.6, 3.6, 6.8, 10.0)


def fill(x, y, z, spacing=0.2):
    """Points of a level rectangle."""
    grid = np.stack(np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing)), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.full(len(grid), z)])


def jam(bare):
    """Rows of cars, close behind each other, on a road that rises; the road is seen only where `bare` says so."""
    road = fill((-45, 45), (-16, 16), 0.0)
    road = road[bare(road)]
    cars = []
    for y in ROWS:
        for x in np.arange(-44, 44, 6.2):
            cars.append(fill((x, x + 1.2), (y - 0.9, y + 0.9), 0.8))
            cars.append(fill((x + 1.9, x + 3.6), (y - 0.9, y + 0.9), 1.45))
            cars.append(fill((x + 3.8, x + 4.5), (y - 0.9, y + 0.9), 0.95))
    every = np.concatenate([road, *cars])
    every[:, 2] += GRADE * every[:, 0]
    return every.astype(np.float32)


def measure_errors(points, x, y):
    places = fill(x, y, 0.0, 1.0)
    places[:, 2] = GRADE * places[:, 0]
    return -find_ground(points).compute_heights_above(places.astype(np.float32))


@pytest.mark.parametrize("half", [2.4, 1.2], ids=["a piece wider than any roof", "only narrow pieces"])
def test_bonnets_and_roofs_of_a_jam_are_not_the_ground(half):
    points = jam(lambda road: np.abs(road[:, 1]) < half)
    errors = measure_errors(points, (-40, 40), (-12, 12))
    assert np.percentile(np.abs(errors), 95) < 0.25
    assert np.median(np.abs(errors)) < 0.1


@pytest.mark.parametrize("grade", [0.08, -0.08])
def test_a_hill_that_begins_at_once_is_ground_all_over(grade):
    rng = np.random.default_rng(0)
    places = rng.uniform((-40, -12), (40, 12), (30_000, 2))
    heights = grade * np.maximum(places[:, 0], 0)
    points = np.column_stack([places, heights]).astype(np.float32)
    assert np.abs(find_ground(points).compute_heights_above(points)).max() < 0.15


def test_a_terrace_behind_a_wall_is_ground_and_a_roof_of_its_height_is_not():
    heights = np.zeros((120, 120))
    heights[:, 70:] = 1.0
    heights[20:30, 20:25] = 1.0
    ground = select_connected(heights, np.ones(heights.shape, bool), CELL)
    assert ground[:, 70:].all()
    assert not ground[20:30, 20:25].any()
    assert ground.sum() == heights.size - 50


def test_a_surface_goes_on_between_and_beyond_what_is_known():
    slope = 0.05 * CELL * np.arange(80.0)[:, None] + np.zeros((80, 60))
    known = slope.copy()
    known[30:50] = np.nan
    assert np.abs(drape_surface(known) - slope)[8:72].max() < 0.08
    flat = np.full((40, 40), 7.0)
    flat[20:] = np.nan
    np.testing.assert_allclose(drape_surface(flat), 7.0, atol=1e-6)
    with pytest.raises(ValueError, match="no height"):
        drape_surface(np.full((4, 4), np.nan))
