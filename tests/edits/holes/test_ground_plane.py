"""The plane of the road is found where splats trained far below it."""

from copy import deepcopy

import numpy as np
from parked_street import CAR, PAVEMENT, ROAD, parked_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.ground_plane import fit_ground_plane, keep_topmost
from instdrive_core.edits.holes.holes import build_ground_grid
from instdrive_core.edits.holes.surroundings import find_surroundings


def test_the_top_of_what_trained_below_a_road_is_the_road() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(-8, 8, (3000, 2))
    road = -0.75 + 0.02 * places[:, 0] - 0.01 * places[:, 1] + rng.normal(0, 0.02, 3000)
    below = np.where(rng.random(3000) < 0.75, rng.exponential(0.6, 3000), 0)
    points = np.c_[places, road - below]
    assert fit_ground_plane(points) is None
    plane = fit_ground_plane(keep_topmost(points))
    assert plane is not None
    assert np.allclose(plane, [-0.75, 0.02, -0.01], atol=[0.04, 0.01, 0.01])


def test_no_points_have_no_top() -> None:
    assert not len(keep_topmost(np.zeros((0, 3))))


def test_a_street_with_splats_below_it_has_a_map() -> None:
    scene = deepcopy(parked_street(views=False).scene)
    rows = np.flatnonzero(np.isin(scene.instance_ids, (ROAD, PAVEMENT)))
    rng = np.random.default_rng(1)
    lower = rows[rng.random(len(rows)) < 0.85]
    scene.gaussians.means[lower, 2] -= rng.exponential(0.6, len(lower)).astype(np.float32)
    document = Document(scene)
    found = find_surroundings(document, [(CAR, document.find_rows((CAR,)))], 0.0)
    assert found is not None
    grid = build_ground_grid(found)
    assert grid is not None
    assert abs(grid.lift_to_ground(found.place[None, :2])[0, 2]) < 0.05
