"""Pieces of one road are joined where they meet without a step; what a kerb, a colour or a gap parts stays apart."""

import numpy as np
import pytest

from instdrive_core.training.instances.ground_height import measure_heights
from instdrive_core.training.instances.level_ground import join_level_ground

ROAD, FAR_ROAD, PAVEMENT, CAR, DRIVEWAY, PATCH, BETWEEN = range(7)
ASPHALT, STONE = (0.3, 0.3, 0.3), (0.32, 0.31, 0.3)


def surface(x, y, height, spacing=0.2):
    """A grid of points over two spans, with 1 cm of noise."""
    places = np.stack(np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing)), axis=-1).reshape(-1, 2)
    noise = np.random.default_rng(len(places)).normal(0, 0.01, len(places))
    return np.column_stack([places, height + noise]).astype(np.float32)


class Street:
    """A road along x in two pieces that meet at x = 10, with a pavement behind a kerb at y = 6."""

    def __init__(self, kerb=0.12, pavement_color=STONE, slope=0.0):
        self.parts = [
            (ROAD, surface((0, 10), (0, 6), 0.0), ASPHALT),
            (FAR_ROAD, surface((10, 20), (0, 6), 0.0), ASPHALT),
            (PAVEMENT, surface((0, 20), (6, 9), kerb), pavement_color),
        ]
        self.slope = slope

    def join(self, more=(), ground=None):
        """Which group each part ends up in, by majority."""
        parts = self.parts + list(more)
        groups = np.concatenate([np.full(len(points), group) for group, points, _ in parts])
        means = np.concatenate([points for _, points, _ in parts])
        means[:, 2] += self.slope * means[:, 0]
        colors = np.concatenate([np.full((len(points), 3), color, np.float32) for _, points, color in parts])
        self.nodes = np.zeros(len(groups), np.uint16)
        self.nodes[groups == CAR] = 1
        swept = means[self.nodes == 0] if ground is None else ground
        heights = measure_heights(means, swept)
        joined = join_level_ground(groups, np.ones(len(groups), np.float32), self.nodes, means, colors, swept, heights)
        return {group: int(np.bincount(joined[groups == group]).argmax()) for group in np.unique(groups).tolist()}


@pytest.mark.parametrize("slope", [0.0, 0.08])
def test_a_road_in_two_pieces_is_one_and_the_pavement_is_not_part_of_it(slope):
    joined = Street(slope=slope).join()
    assert joined[ROAD] == joined[FAR_ROAD] != joined[PAVEMENT]


def test_what_is_level_but_of_another_colour_stays_apart():
    joined = Street(kerb=0.0, pavement_color=(0.3, 0.45, 0.2)).join()
    assert joined[ROAD] == joined[FAR_ROAD] != joined[PAVEMENT]


@pytest.mark.parametrize(("color", "joins"), [((0.14, 0.15, 0.16), True), ((0.15, 0.28, 0.08), False)])
def test_a_patch_amid_the_road_is_shade_or_a_lawn(color, joins):
    """It begins in the next piece of the road: that one alone must not decide for both."""
    street = Street()
    for place, (group, points, asphalt) in enumerate(street.parts):
        amid = (np.abs(points[:, 0] - 8) < 3) & (np.abs(points[:, 1] - 3) < 1.5)
        street.parts[place] = (group, points[~amid], asphalt)
    joined = street.join([(PATCH, surface((5, 11), (1.5, 4.5), 0.0), color)])
    assert joined[ROAD] == joined[FAR_ROAD] != joined[PAVEMENT]
    assert (joined[PATCH] == joined[ROAD]) == joins


def test_shade_does_not_part_a_road_because_it_meets_one_piece_most():
    """Joined with that piece first, it would differ from the other one by more than the two pieces do."""
    street = Street()
    street.parts[0] = (ROAD, surface((0, 8), (0, 6), 0.0), ASPHALT)
    dim = [(PATCH, surface((8, 12), (0, 5), 0.0), (0.18,) * 3), (BETWEEN, surface((8, 12), (5, 6), 0.0), (0.24,) * 3)]
    street.parts[1] = (FAR_ROAD, surface((12, 20), (0, 6), 0.0), ASPHALT)
    joined = street.join(dim)
    assert joined[ROAD] == joined[BETWEEN] == joined[FAR_ROAD] != joined[PAVEMENT]


def test_a_driveway_goes_with_the_road_and_does_not_join_it_to_the_pavement():
    """It is level with both where it meets them; but they have a kerb along all the rest of the street."""
    street = Street()
    group, pavement, color = street.parts[2]
    pavement = pavement[np.abs(pavement[:, 0] - 5) > 1.5]
    street.parts[2] = (group, pavement, color)
    ramp = surface((3.5, 6.5), (6, 9), 0.0)
    ramp[:, 2] += 0.12 * np.clip((ramp[:, 1] - 6) / 3, 0, 1)
    joined = street.join([(DRIVEWAY, ramp, ASPHALT)])
    assert joined[ROAD] == joined[FAR_ROAD] != joined[PAVEMENT]


def test_a_car_on_the_road_is_no_ground():
    body = surface((4, 8), (2, 4), 0.7)
    shadow = surface((4, 8), (2, 4), 0.0)
    street = Street()
    joined = street.join([(CAR, np.concatenate([body, body, shadow]), ASPHALT)])
    assert joined[CAR] == CAR
    assert joined[ROAD] == joined[FAR_ROAD]


def test_without_points_of_the_ground_nothing_is_joined():
    joined = Street().join(ground=np.zeros((0, 3), np.float32))
    assert joined == {ROAD: ROAD, FAR_ROAD: FAR_ROAD, PAVEMENT: PAVEMENT}


def test_gaussians_of_no_group_stay_in_none():
    points = surface((0, 10), (0, 6), 0.0)
    groups = np.where(points[:, 0] < 5, 0, -1)
    colors, weights = np.full((len(points), 3), 0.3, np.float32), np.ones(len(points), np.float32)
    nodes, heights = np.zeros(len(points), np.uint16), measure_heights(points, points)
    joined = join_level_ground(groups, weights, nodes, points, colors, points, heights)
    np.testing.assert_array_equal(joined, groups)
