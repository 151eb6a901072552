"""The ground parts at kerbs: tests on streets made of points."""

from __future__ import annotations

import numpy as np
import pytest

from instdrive_core.masks.lidar.cluster_kind import FACADE, GROUND, NONE, THING
from instdrive_core.masks.lidar.cluster_motion import MovingCluster
from instdrive_core.masks.lidar.ground_pieces import part_ground
from instdrive_core.masks.lidar.regions import fill_label_holes
from instdrive_core.masks.lidar.scene import LidarScene

PATH = np.column_stack([np.linspace(-10, 10, 20), np.zeros(20), np.full(20, 1.8)])
KERB = 5.0
"""Metres from the road's middle to its kerbs."""


def make_street(height, noise=0.015, hidden=None):
    """Points of a street along x, 60 m long and 18 m wide; `height(x, y)` in metres; none where `hidden` is true."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-30, 30, 40000), rng.uniform(-9, 9, 40000)
    if hidden is not None:
        x, y = x[~hidden(x, y)], y[~hidden(x, y)]
    z = height(x, y) + rng.normal(0, noise, len(x))
    return np.column_stack([x, y, z]).astype(np.float32)


def crown(x, y):
    """A road that falls from its middle by 3 %, and goes uphill by 8 %."""
    return 0.08 * x - 0.03 * np.abs(y)


def with_pavements(x, y):
    """Such a road between pavements 10 cm higher."""
    return crown(x, y) + 0.1 * (np.abs(y) > KERB)


def find(points, places):
    """Numbers of the pieces under places given by x and y."""
    pieces = part_ground(points, PATH)
    return pieces.find(np.column_stack([np.array(places, float), np.zeros(len(places))]).astype(np.float32)).tolist()


def test_pavements_are_parted_from_the_road_and_from_each_other():
    road, left, right = find(make_street(with_pavements), [(0, 0), (0, -7), (0, 7)])
    assert road == 0, "the largest one comes first"
    assert len({road, left, right}) == 3
    places = [(x, y) for x in (-25, -12, 0, 12, 25) for y in (-4.5, 0, 4.5)]
    assert set(find(make_street(with_pavements), places)) == {road}


@pytest.mark.parametrize(
    "height",
    [
        crown,
        lambda x, y: 0.15 * x + 0.1 * y,
        lambda x, y: 0.003 * x**2 - 0.05 * np.sqrt(y**2 + 1),
        lambda x, y: crown(x, y) + 0.02 * (np.abs(y - 2) < 0.8),
        lambda x, y: crown(x, y) + np.clip((np.abs(y) - KERB) / 2, 0, 1) * 0.15,
    ],
    ids=["crown", "hillside", "valley", "patch", "ramp"],
)
def test_ground_without_a_kerb_is_one_piece(height):
    assert part_ground(make_street(height, noise=0.025), PATH).count == 1


def test_a_driveway_joins_the_pavement_to_the_road_no_more_than_it_must():
    def height(x, y):
        lowered = (np.abs(x) < 2) * np.clip((KERB + 1.5 - y) / 1.5, 0, 1)
        return with_pavements(x, y) - 0.1 * (y > KERB) * lowered

    road, before, behind = find(make_street(height), [(0, 0), (-10, 7), (10, 7)])
    assert before == behind != road


def test_a_pavement_goes_on_behind_a_parked_car_and_a_road_behind_a_lorry():
    def hidden(x, y):
        return (np.abs(x) < 1.5) & (y > 4) | (np.abs(x - 8) < 1.2) & (y < 5)

    points = make_street(with_pavements, hidden=hidden)
    road, beyond, before, behind = find(points, [(0, 0), (20, 0), (-10, 7), (10, 7)])
    assert road == beyond
    assert before == behind != road


def test_a_side_street_that_begins_to_climb_behind_a_lorry_is_the_road():
    def hidden(x, y):
        return (y > KERB) & ((np.abs(x) > 4) | (y < KERB + 2.5))

    points = make_street(lambda x, y: 0.02 * x + 0.04 * np.maximum(y - KERB, 0), hidden=hidden)
    assert part_ground(points, PATH).count == 1


def test_a_traffic_island_is_a_piece_and_a_manhole_is_none():
    island = make_street(lambda x, y: crown(x, y) + 0.12 * ((np.abs(x) < 4) & (np.abs(y) < 1.5)))
    middle, road = find(island, [(0, 0), (0, 5)])
    assert middle != road
    assert part_ground(make_street(lambda x, y: crown(x, y) - 0.06 * (np.hypot(x, y - 3) < 0.4)), PATH).count == 1


@pytest.mark.parametrize("count", [0, 1, 30])
def test_little_ground_is_one_piece(count):
    points = make_street(with_pavements)[:count]
    pieces = part_ground(points, PATH)
    assert pieces.count == 1
    assert (pieces.find(points) == 0).all()


def test_points_far_from_the_path_get_what_is_nearest():
    pieces = part_ground(make_street(with_pavements), PATH)
    ends = np.array([[500, 0, 0], [-500, 0.5, 0]], np.float32)
    assert ((pieces.find(ends) >= 0) & (pieces.find(ends) < pieces.count)).all()


def test_what_stands_on_the_ground_keeps_its_kind_when_the_ground_is_parted():
    ground = make_street(with_pavements)
    others = np.array([[0, 9, 3], [3, 2, 1]], np.float32)
    ids = np.array([GROUND] * len(ground) + [2, 3], np.uint32)
    moving = {0.5: [MovingCluster(4, others, np.zeros(3))]}
    scene = LidarScene(
        np.concatenate([ground, others]), ids, np.array([NONE, GROUND, FACADE, THING], np.uint32), moving
    )
    parted = scene.part_ground(PATH)
    assert parted.kinds.tolist() == [NONE, GROUND, GROUND, GROUND, FACADE, THING]
    assert parted.ids[-2:].tolist() == [4, 5]
    assert [one.id for one in parted.moving[0.5]] == [6]
    assert list(parted.group_things()) == [5]
    assert 0.9 * len(ground) < len(parted.ground) < len(ground), "right at a kerb, photos tell better"


def test_a_traffic_island_in_a_photo_is_no_hole_in_the_road():
    labels, depths = np.zeros((40, 60), np.int32), np.full((40, 60), 10, np.float32)
    labels[18:22, 20:30] = 1
    assert (fill_label_holes(labels, depths, floors=range(2), things=range(3, 4)) == labels).all()
    assert (fill_label_holes(labels, depths, floors=range(1), things=range(3, 4)) == 0).all()
