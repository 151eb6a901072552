"""Partners look the same way, and those with the best parallax come first."""

import numpy as np

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.stereo.agreement import count_agreeing
from instdrive_core.stereo.partners import MOST_PARTNERS, choose_partners, list_near_partners

MIDDLE = np.array([0.0, 5.0, 0.0])


def stand(x, target=MIDDLE):
    return Camera(100.0, 100.0, 80.0, 60.0, 160, 120, look_at(np.array([x, 0.0, 0.0]), target))


def around(count, degrees):
    angles = np.radians(np.arange(count) * degrees)
    return [
        Camera(100.0, 100.0, 80.0, 60.0, 160, 120, look_at(5 * np.array([np.sin(a), -np.cos(a), 0]), np.zeros(3)))
        for a in angles
    ]


def test_near_partners_look_the_same_way_and_stand_elsewhere():
    cameras = [stand(0), stand(0), stand(1), stand(0.5), stand(0.3, np.array([0.3, -5, 0]))]
    near = list_near_partners(cameras)
    assert near[0].tolist()[0] == 3
    assert 1 not in near[0]
    assert 4 not in near[0]
    assert len(near[4]) == 0


def test_the_best_angle_beats_the_nearest():
    cameras = around(20, 2.5)
    points = [np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3))] * len(cameras)
    (chosen, *_) = choose_partners(cameras, points)
    assert len(chosen) == MOST_PARTNERS
    assert chosen[0] == 3
    assert 1 not in chosen
    assert chosen.max() < 8


def test_photos_that_show_something_else_are_no_partners():
    cameras = [stand(0), stand(0.6), stand(0.6, np.array([60.0, 5, 0]))]
    chosen = choose_partners(cameras, [MIDDLE[None] + np.random.default_rng(1).normal(0, 0.2, (30, 3))] * 3)
    assert chosen[0].tolist() == [1]


def test_without_points_nobody_is_a_partner():
    assert [len(one) for one in choose_partners([stand(0), stand(1)], [np.zeros((0, 3))] * 2)] == [0, 0]


def test_agreement_is_counted_both_ways():
    forward = np.array([0, 10.0, 0])
    cameras = [stand(x, np.array([x, 0, 0]) + forward) for x in (0.0, 0.4)]
    wall = np.full((120, 160), 1 / 5, np.float32)  # both look at a wall 5 m away
    agreeing = count_agreeing(wall, cameras[0], [(wall, cameras[1])])
    assert agreeing[:, 10:].all()
    assert not agreeing[:, :7].any()  # out of the other's picture
    assert not count_agreeing(wall, cameras[0], [(wall * 1.2, cameras[1])]).any()
    assert not count_agreeing(np.zeros_like(wall), cameras[0], [(wall, cameras[1])]).any()
    assert not count_agreeing(wall, cameras[0], [(np.zeros_like(wall), cameras[1])]).any()
