"""Which ground around a hole may be copied."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, PAVEMENT, ROAD, parked_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.holes import build_ground_grid, find_known_ground
from instdrive_core.edits.holes.surroundings import find_surroundings
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color

SHADOW = (0.4, 6.5)
"""The middle of what the other car leaves dark, x and y."""


@pytest.mark.parametrize(("house", "known_there"), [(False, False), (True, True)])
def test_the_shadow_of_the_next_car_is_not_copied_into_the_sun(house: bool, known_there: bool) -> None:
    scene = deepcopy(parked_street(views=False).scene)
    x, y = scene.gaussians.means[:, 0], scene.gaussians.means[:, 1]
    dark = (np.abs(x - SHADOW[0]) < 0.6) & (np.abs(y - SHADOW[1]) < 2.1)
    if house:  # that car's shadow is then only a part of the shade
        dark |= np.abs(y) < 9
    rows = np.flatnonzero(dark & np.isin(scene.instance_ids, (ROAD, PAVEMENT)))
    scene.gaussians.sh_dc[rows] = dc_from_color(0.4 * color_from_dc(scene.gaussians.sh_dc[rows]))
    document = Document(scene)
    found = find_surroundings(document, [(CAR, document.find_rows((CAR,)))], 0.0)
    assert found is not None
    grid = build_ground_grid(found)
    assert grid is not None
    places = grid.compute_centers(grid.list_cells())
    hole = (np.abs(places - CAR_CENTER[:2]) < CAR_SIZE[:2] / 2).all(axis=1).reshape(grid.shape)
    _, known = find_known_ground(document, grid, found.around, hole)
    shadow = (np.abs(places - SHADOW) < [0.3, 1.5]).all(axis=1).reshape(grid.shape)
    beside = (np.abs(places - [-1.5, SHADOW[1]]) < [0.5, 1.5]).all(axis=1).reshape(grid.shape)
    assert known[beside].all()
    assert known[shadow].mean() == pytest.approx(float(known_there), abs=0.1)
