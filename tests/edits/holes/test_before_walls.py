"""Ground behind a wall is no part of a hole before it."""

from dataclasses import fields, replace

import numpy as np
import pytest

from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_map import find_cells_before_walls
from instdrive_core.edits.holes.surroundings import Neighborhood

GRID = GroundGrid((7.0, -12.0), (0.0, 1.0), 0.2, (120, 70), (0.0, 0.0, 0.0))
WALL = 3.1
"""Where it stands along x, metres."""


def stand(heights: tuple[float, float], length: float, compact: bool = False, tall: bool = False) -> Neighborhood:
    """Splats of something upright along the lane, `heights` and `length` in metres."""
    rng = np.random.default_rng(0)
    count = 6000
    means = np.c_[
        rng.normal(WALL, 0.02, count), rng.uniform(-length / 2, length / 2, count), rng.uniform(*heights, count)
    ]
    return Neighborhood(
        np.arange(count), means.astype(np.float32), np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        np.full((count, 3), 0.05, np.float32), np.full(count, 0.9, np.float32), np.full((count, 3), 0.5),
        np.ones(count, np.uint32), np.zeros(count, bool), np.full(count, compact), np.full(count, tall),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("near", "stops"),
    [
        (stand((0.9, 5.0), 24), True),  # a car hides its foot
        (stand((0.9, 8.0), 12, compact=True, tall=True), True),  # a narrow house
        (stand((2.8, 6.0), 24), False),  # crowns of trees
        (stand((0.4, 1.5), 24, compact=True), False),  # cars in a row
        (stand((0.4, 5.0), 2), False),  # posts
    ],
)
def test_a_wall_stops_a_hole(near: Neighborhood, stops: bool) -> None:
    x, y = GRID.compute_centers(GRID.list_cells()).T
    footprint = ((x > 0) & (x < 4) & (np.abs(y) < 2)).reshape(GRID.shape)  # a hull with some strays behind the wall
    places = x.reshape(GRID.shape)
    before = find_cells_before_walls(GRID, near, footprint)
    assert before[places < WALL].all()
    assert before[places > WALL + 0.5].any() != stops


def test_what_stands_in_walls_altogether_has_no_side() -> None:
    near = stand((0.9, 5.0), 24)
    places = GRID.compute_centers(GRID.list_cells())[:, 0].reshape(GRID.shape)
    assert find_cells_before_walls(GRID, near, np.abs(places - WALL) < 0.15).all()
    nothing = replace(near, **{entry.name: getattr(near, entry.name)[:0] for entry in fields(near)})
    assert find_cells_before_walls(GRID, nothing, np.zeros(GRID.shape, bool)).all()
