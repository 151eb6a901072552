"""A moving object's instance holds nothing of the background that stands where the object never is."""

import numpy as np
from scipy.sparse import csr_array

from instdrive_core.scene.track import Track
from instdrive_core.training.instances.mover_reach import REACH, find_strays, give_strays_away

BOX = np.array([2.0, 4.0, 1.5])
ROAD, SHOP, CAR = 0, 1, 2


def drive(metres):
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 1, 3] = np.linspace(0, metres, 6)
    return Track("a", "Car", BOX, np.linspace(0, 0.5, 6), poses, moving=True)


def lay(*places):
    """Gaussians of the background at these places, all in the car's group, then one of the car, in its own frame."""
    means = np.array([*places, (0, 0, 0)], np.float32)
    nodes = np.array([*[0] * len(places), 1], np.uint16)
    return np.full(len(means), CAR), means, nodes


def test_what_stands_where_the_car_never_is_is_a_stray():
    groups, means, nodes = lay((0, 0, 0), (0, 6, 0.5), (0, 30, 1), (0, -12, 1), (1 + 0.9 * REACH, 3, 0), (5, 3, 0))
    strays = find_strays(groups, means, nodes, (drive(6.0),))
    assert strays.tolist() == [False, False, True, True, False, True, False]


def test_what_is_where_the_car_comes_late_is_none():
    groups, means, nodes = lay((0, 20, 0))
    assert find_strays(groups, means, nodes, (drive(6.0),))[0]
    assert not find_strays(groups, means, nodes, (drive(20.0),))[0]


def test_groups_without_a_moving_object_have_none():
    groups, means, nodes = lay((0, 30, 1))
    groups[0] = SHOP
    assert not find_strays(groups, means, nodes, (drive(6.0),)).any()
    assert not find_strays(groups[:1], means[:1], nodes[:1], ()).any()


def test_strays_go_to_what_stands_and_got_most_of_their_votes():
    groups, _, nodes = lay((0, 30, 1), (0, 31, 1), (0, 0, 0))
    shares = csr_array(np.array([[0.1, 0.3, 0.6], [0.0, 0.0, 1.0], [0.4, 0.0, 0.6], [0.0, 0.0, 1.0]], np.float32))
    given = give_strays_away(groups, np.array([True, True, False, False]), nodes, shares)
    assert given.tolist() == [SHOP, -1, CAR, CAR]
