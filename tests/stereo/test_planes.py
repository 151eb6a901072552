"""Planes lie about a pixel apart, as near as somebody looks, and tell no depth where parallax is too small."""

import numpy as np
import pytest

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.stereo.pixel_relation import relate_pixels
from instdrive_core.stereo.planes import choose_planes


def stand(x, y=0.0):
    place = np.array([x, y, 0.0])
    return Camera(100.0, 100.0, 80.0, 60.0, 160, 120, look_at(place, place + np.array([0, 10.0, 0])))


def move_of_middle(camera, partner, inverse):
    turn, shift = relate_pixels(camera, partner)
    seen = np.array([camera.cx, camera.cy, 1.0]) @ turn.T + inverse[:, None] * shift
    return np.linalg.norm(np.diff(seen[:, :2] / seen[:, 2:], axis=0), axis=1)


def test_a_step_is_a_pixel_of_the_partner_that_moves_most():
    camera, partners = stand(0), [stand(0.5), stand(1.0)]
    planes = choose_planes(camera, partners, nearest=1.0)
    steps = move_of_middle(camera, partners[1], planes.inverse)
    assert planes.inverse[0] == 0
    assert np.all(np.diff(planes.inverse) > 0)
    assert np.median(steps) == pytest.approx(1, abs=0.1)


def test_the_nearest_plane_is_the_one_asked_for():
    planes = choose_planes(stand(0), [stand(1.0)], nearest=0.25)
    assert planes.inverse[-1] == pytest.approx(0.25)


def test_planes_end_where_no_partner_shows_them():
    camera, partner = stand(0), stand(1.0)
    nearest = choose_planes(camera, [partner]).inverse[-1]
    assert 100 * nearest < camera.width  # moved by a whole photo at most
    assert 100 * nearest > camera.width / 2


def test_driving_ahead_shows_what_is_nearer_than_a_step():
    planes = choose_planes(stand(0, 5.0), [stand(0, 0.0)])
    assert 1 / planes.inverse[-1] < 1.0


def test_far_planes_tell_no_depth():
    planes = choose_planes(stand(0), [stand(1.0)])
    numbers = np.arange(len(planes), dtype=np.float32)[None]
    found = planes.look_up(numbers)[0]
    assert not found[:4].any()
    np.testing.assert_allclose(found[10:], planes.inverse[10:], rtol=1e-6)
    between = planes.look_up(np.float32([[20.5]]))[0, 0]
    assert planes.inverse[20] < between < planes.inverse[21]


def test_without_partners_there_are_no_planes():
    assert len(choose_planes(stand(0), [])) == 0
    assert (
        len(choose_planes(stand(0), [Camera(100.0, 100.0, 80.0, 60.0, 160, 120, look_at(np.zeros(3), -np.eye(3)[1]))]))
        == 0
    )
