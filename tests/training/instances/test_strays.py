"""An instance holds nothing of the background that stands far from the thing, or where a moving one never is."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from instdrive_core.scene.track import Track
from instdrive_core.training.instances.strays import REACH, Reach, find_reaches, find_strays, give_strays_away

BOX = np.array([2.0, 4.0, 1.5])
ROAD, SHOP, CAR = 0, 1, 2


def drive(metres, box=BOX):
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 1, 3] = np.linspace(0, metres, 6)
    return Track("a", "Car", box, np.linspace(0, 0.5, 6), poses, moving=True)


def lay(*places):
    """Gaussians of the background at these places, all in the car's group, then one of the car, in its own frame."""
    means = np.array([*places, (0, 0, 0)], np.float32)
    nodes = np.array([*[0] * len(places), 1], np.uint16)
    return np.full(len(means), CAR), means, nodes


def find(groups, means, nodes, *tracks):
    reaches = find_reaches(groups, means, np.ones(len(groups), np.float32), nodes, tracks)
    return find_strays(groups, means, nodes, reaches)


def fill_box(center, size=(1.8, 4.4, 1.5), count=400, seed=0):
    """Gaussians of something that stands."""
    offsets = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3)) * size
    return (offsets + center).astype(np.float32)


def stand(*pieces):
    """All pieces in the car's group, all in the background."""
    means = np.concatenate(pieces).astype(np.float32)
    return np.full(len(means), CAR), means, np.zeros(len(means), np.uint16)


class TestMoving:
    def test_what_stands_where_the_car_never_is_is_a_stray(self):
        groups, means, nodes = lay((0, 0, 0), (0, 6, 0.5), (0, 30, 1), (0, -12, 1), (1 + 0.9 * REACH, 3, 0), (5, 3, 0))
        strays = find(groups, means, nodes, drive(6.0))
        assert strays.tolist() == [False, False, True, True, False, True, False]

    def test_what_is_where_the_car_comes_late_is_none(self):
        groups, means, nodes = lay((0, 20, 0))
        assert find(groups, means, nodes, drive(6.0))[0]
        assert not find(groups, means, nodes, drive(20.0))[0]

    def test_somebody_on_foot_takes_no_door_along(self):
        groups, means, nodes = lay((0.3, 1, 0), (1.2, 1, 0), (0, -1, 0))
        walker = drive(2.0, np.array([0.6, 0.8, 1.8]))
        assert find(groups, means, nodes, walker).tolist() == [False, True, False, False]

    def test_groups_without_a_moving_object_have_none(self):
        groups, means, nodes = lay((0, 30, 1))
        groups[0] = SHOP
        assert not find(groups, means, nodes, drive(6.0)).any()
        assert not find(groups[:1], means[:1], nodes[:1]).any()


class TestStanding:
    def test_what_is_far_behind_a_parked_car_is_a_stray(self):
        car, behind = fill_box((0, 0, 0.75)), np.array([(0.5, 40, 1), (0, 45, 2), (1, 90, 12)])
        strays = find(*stand(car, behind))
        assert not strays[: len(car)].any()
        assert strays[len(car) :].all()

    def test_what_is_near_it_is_none(self):
        car, mirror = fill_box((0, 0, 0.75)), np.array([(0.9 + 0.9 * REACH, 1, 0.9)])
        assert not find(*stand(car, mirror)).any()

    def test_what_hangs_together_with_it_is_none(self):
        rope = np.stack([np.zeros(12), np.linspace(2, 10, 12), np.full(12, 0.8)], axis=1)
        assert not find(*stand(fill_box((0, 0, 0.75)), rope)).any()

    @pytest.mark.parametrize("share", [0.2, 0.8])
    def test_a_hedge_that_goes_on_behind_a_car_is_one_thing(self, share):
        rest = fill_box((0, 9, 0.75), count=round(400 * share), seed=1)
        assert not find(*stand(fill_box((0, 0, 0.75)), rest)).any()

    def test_a_tree_may_go_on_behind_a_house(self):
        tree = fill_box((0, 0, 4), (4, 4, 8), count=1600)
        assert not find(*stand(tree, np.array([(0, 9, 6)]))).any()

    def test_a_wall_is_too_long_to_tell(self):
        wall = fill_box((0, 0, 1), (0.3, 16, 2), count=1600)
        assert not find(*stand(wall, np.array([(0, 12, 1)]))).any()

    def test_faint_splats_do_not_say_where_a_thing_is(self):
        haze = fill_box((0, 30, 0.75), count=500, seed=1)
        groups, means, nodes = stand(fill_box((0, 0, 0.75)), haze, np.array([(0, 60, 1)]))
        opacities = np.ones(len(groups), np.float32)
        opacities[400:900] = 0.01
        assert find_reaches(groups, means, opacities, nodes, ())[CAR].body.center == pytest.approx(
            (0, 0, 0.75), abs=0.2
        )


class TestGivenAway:
    def test_strays_go_to_what_stands_and_got_most_of_their_votes(self):
        groups, means, nodes = lay((0, 30, 1), (0, 31, 1), (0, 0, 0))
        shares = csr_array(np.array([[0.1, 0.3, 0.6], [0.0, 0.0, 1.0], [0.4, 0.0, 0.6], [0.0, 0.0, 1.0]], np.float32))
        reaches = find_reaches(groups, means, np.ones(4, np.float32), nodes, (drive(6.0),))
        given = give_strays_away(groups, np.array([True, True, False, False]), means, shares, reaches)
        assert given.tolist() == [SHOP, -1, CAR, CAR]

    def test_no_other_thing_that_is_far_from_them_gets_them(self):
        groups, means = np.array([CAR, CAR]), np.array([(0, 30, 1), (0, 2, 1)], np.float32)
        shares = csr_array(np.array([[0.1, 0.4, 0.5], [0.1, 0.4, 0.5]], np.float32))
        parked = find_reaches(*_arguments(fill_box((0, 0, 0.75))))[CAR]
        given = give_strays_away(groups, np.ones(2, bool), means, shares, {CAR: Reach((drive(6.0),)), SHOP: parked})
        assert given.tolist() == [ROAD, SHOP]

    def test_nothing_that_moves_gets_them(self):
        groups, means = np.array([CAR]), np.array([(0, 2, 0)], np.float32)
        shares = csr_array(np.array([[0.1, 0.4, 0.5]], np.float32))
        given = give_strays_away(groups, np.ones(1, bool), means, shares, {CAR: Reach(), SHOP: Reach((drive(6.0),))})
        assert given.tolist() == [ROAD]


def _arguments(points):
    groups, means, nodes = stand(points)
    return groups, means, np.ones(len(groups), np.float32), nodes, ()
