"""What LiDAR saw standing on the ground leaves the group of the ground, and nothing else does."""

import numpy as np
import pytest

from instdrive_core.training.instances.standing_things import part_standing_things

ROAD, CAR, NONE = 0, 1, -1
CONE = 7


class Street:
    """100 Gaussians of a road, 20 of a cone in the road's group, 40 of a car in its own."""

    def __init__(self):
        self.groups = np.repeat([ROAD, ROAD, CAR], [100, 20, 40])
        self.things = np.repeat([NONE, CONE, 3], [100, 20, 40])
        self.heights = np.concatenate([np.zeros(100), np.linspace(0.0, 0.5, 20), np.linspace(0.1, 1.4, 40)])
        self.weights = np.ones(160, np.float32)
        self.nodes = np.zeros(160, np.uint16)

    def part(self):
        heights = self.heights.astype(np.float32)
        return part_standing_things(self.groups, self.weights, self.nodes, heights, self.things)


def test_a_cone_leaves_the_road_except_for_what_lies_on_it():
    street = Street()
    parted = street.part()
    stands = (street.things == CONE) & (street.heights > 0.05)
    assert set(parted[stands].tolist()) == {2}
    assert parted[~stands].tolist() == street.groups[~stands].tolist()


def test_two_things_in_the_road_are_two():
    street = Street()
    street.groups[120:] = ROAD
    street.weights[:100] = 5  # or all of this would be no ground
    parted = street.part()
    assert set(parted[120:].tolist()) == {1}
    assert set(parted[102:120].tolist()) == {2}


@pytest.mark.parametrize("change", ["low", "few", "unseen", "moves", "unknown", "elsewhere"])
def test_it_stays_where_lidar_may_be_wrong(change):
    street = Street()
    cone = street.things == CONE
    if change == "low":
        street.heights[cone] *= 0.5
    elif change == "few":
        street.things[100:112] = NONE
    elif change == "unseen":
        street.weights[cone] = 0
    elif change == "moves":
        street.nodes[cone] = 1
    elif change == "unknown":
        street.heights[cone] = np.inf
        street.weights[:100] = 5
    elif change == "elsewhere":
        street.groups[100:112] = CAR  # most of what stands has a group that is no ground
    assert street.part().tolist() == street.groups.tolist()
