"""Lines along the lane on which a vehicle stood."""

import numpy as np
import pytest

from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.lanes.parking_lines import find_parking_lines

GRID = GroundGrid((-5.0, -12.0), (0.0, 1.0), 0.2, (120, 70), (0.0, 0.0, 0.0))
"""The lane runs along y; its lines lie at falling x."""


def box_of_points(width, length, height):
    rng = np.random.default_rng(3)
    return rng.uniform([-9 - width / 2, -length / 2, 0.3], [-9 + width / 2, length / 2, height], (2000, 3))


def test_a_parked_car_tells_its_lines():
    strays = np.array([[-2.0, 0.0, 1.0], [-9.0, 0.0, -4.0]])
    lines = find_parking_lines(np.concatenate([box_of_points(1.8, 4.2, 1.5), strays]), GRID)
    middles = GRID.compute_centers(np.argwhere(lines[None]))[:, 0]
    assert middles.min() == pytest.approx(-10, abs=0.25)
    assert middles.max() == pytest.approx(-8, abs=0.25)
    assert lines.sum() == len(np.arange(np.flatnonzero(lines)[0], np.flatnonzero(lines)[-1] + 1))


@pytest.mark.parametrize("size", [(0.5, 0.5, 1.2), (6.0, 8.0, 3.0), (1.8, 4.2, 0.15)])
def test_what_is_no_parked_vehicle_tells_nothing(size):
    width, length, height = size
    points = box_of_points(width, length, 1.5)
    points[:, 2] *= height / 1.5
    assert not find_parking_lines(points, GRID).any()
