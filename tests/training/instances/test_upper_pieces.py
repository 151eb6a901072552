"""Storeys above storeys: what hangs goes to what carries it, and to nothing else."""

import numpy as np
import pytest

from instdrive_core.training.instances.upper_pieces import join_upper_pieces

LOWER, UPPER, NEXT = 0, 1, 2


def build_wall(left, right, foot, top, depth=0.0):
    """A wall that faces the road: a Gaussian every 25 cm."""
    across, up = np.meshgrid(np.arange(left, right, 0.25), np.arange(foot, top, 0.25))
    return np.column_stack([across.ravel(), np.full(across.size, depth), up.ravel()])


def join(parts, steep=None, nodes=None, slope=0.0, round_part=None, owners=None):
    """Groups of the parts after joining; the ground lies at -1.5 m and falls by `slope` along the road."""
    means = np.concatenate(parts)
    numbers = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    groups = numbers if owners is None else np.array(owners)[numbers]
    means[:, 2] -= 1.5 + slope * means[:, 0]
    steep = [True] * len(parts) if steep is None else steep
    normals = np.where(np.array(steep)[numbers][:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    if round_part is not None:
        bearings = np.random.default_rng(0).uniform(0, 2 * np.pi, len(means))[numbers == round_part]
        normals[numbers == round_part] = np.column_stack([np.cos(bearings), np.sin(bearings), 0 * bearings])
    along, across = np.meshgrid(np.arange(-5, 30, 0.5), np.arange(-6, 1, 0.5))
    ground = np.column_stack([along.ravel(), across.ravel(), -1.5 - slope * along.ravel()]).astype(np.float32)
    nodes = np.zeros(len(means), np.uint16) if nodes is None else np.array(nodes, np.uint16)[numbers]
    shown, means = np.ones(len(means), np.float32), means.astype(np.float32)
    joined = join_upper_pieces(groups, shown, nodes, means, normals, ground)
    names = [np.unique(joined[numbers == part]) for part in range(len(parts))]
    assert all(len(name) == 1 for name in names)
    return [int(name[0]) for name in names]


@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_an_upper_storey_goes_to_the_house_beneath(slope):
    lower, upper, following = build_wall(0, 8, 0, 3), build_wall(0, 8, 3, 7), build_wall(8, 16, 0, 7)
    assert join([lower, upper, following], slope=slope) == [LOWER, LOWER, NEXT]


def test_a_gable_above_an_upper_storey_goes_to_the_same_house():
    assert join([build_wall(0, 8, 0, 3), build_wall(0, 8, 3, 7), build_wall(1, 7, 7, 9)]) == [LOWER, LOWER, LOWER]


def test_a_piece_above_two_houses_stays_by_itself():
    parts = [build_wall(0, 8, 0, 3), build_wall(0, 16, 3, 7), build_wall(8, 16, 0, 3)]
    assert join(parts) == [LOWER, UPPER, NEXT]


def test_what_hangs_above_a_car_is_no_part_of_it():
    assert join([build_wall(0, 4, 0, 1.7), build_wall(0, 4, 2.25, 4)]) == [0, 1]


def test_a_crown_and_a_sign_above_a_house_are_no_part_of_it():
    house, upper = build_wall(0, 8, 0, 3), build_wall(1, 7, 3, 7)
    assert join([house.copy(), upper.copy()]) == [0, 0]
    assert join([house.copy(), upper], round_part=1) == [0, 1]
    assert join([house, build_wall(1, 2.5, 3, 4)]) == [0, 1]


def test_what_hangs_before_a_house_without_touching_it_stays_by_itself():
    house = build_wall(0, 8, 0, 7)
    assert join([house, build_wall(2, 5, 3, 4, depth=-3)]) == [0, 1]
    assert join([build_wall(0, 8, 0, 2.5), build_wall(0, 8, 5, 7)]) == [0, 1]


def test_roofs_carry_nothing():
    assert join([build_wall(0, 8, 0, 3), build_wall(0, 8, 3, 7)], steep=[False, True]) == [0, 1]


def test_a_lorry_stays_whole_where_a_part_of_it_hangs_on_a_house():
    house, hanging, moving = build_wall(0, 8, 0, 2.75), build_wall(0, 8, 3, 4), build_wall(20, 22, 3, 4)
    assert join([house.copy(), hanging.copy(), moving.copy()], owners=[0, 1, 2]) == [0, 0, 2]
    assert join([house.copy(), hanging.copy(), moving.copy()], owners=[0, 1, 1]) == [0, 0, 0]
    assert join([house, hanging, moving], owners=[0, 1, 1], nodes=[0, 0, 4]) == [0, 1, 1]


def test_without_anything_nothing_is_joined():
    groups = np.array([0, -1, 1])
    means, normals = np.array([[0, 0, 0], [0, 0, 3], [0, 0, 6]], np.float32), np.eye(3)
    nodes, nothing = np.zeros(3, np.uint16), np.zeros((0, 3), np.float32)
    shown = np.ones(3, np.float32)
    assert join_upper_pieces(groups, shown, nodes, means, normals, nothing) is groups
    ground = np.zeros((1, 3), np.float32)
    assert join_upper_pieces(groups, 0 * shown, nodes, means, normals, ground) is groups
    np.testing.assert_array_equal(join_upper_pieces(groups, shown, nodes, means, normals, ground), groups)
