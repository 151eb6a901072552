"""Costs are lowest where a photo and its partners show the same, in whatever brightness."""

import numpy as np
import pytest
from moving_photos import read_texture

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.stereo.plane_sweep import UNKNOWN, compute_costs

INVERSE = np.linspace(0, 0.5, 26)
TRUE = 10
"""Number of the plane at 5 m, where the textured wall stands."""


def stand(x):
    place = np.array([x, 0.0, 0.0])
    return Camera(80.0, 80.0, 40.0, 30.0, 80, 60, look_at(place, place + np.array([0, 10.0, 0])))


def photograph(camera):
    """A textured wall at y = 5 m."""
    rays = camera.compute_ray_directions()
    hit = camera.position + rays * (5 / rays[..., 1:2])
    return read_texture(1, hit[..., 0].ravel(), hit[..., 2].ravel()).reshape(60, 80).astype(np.float32)


@pytest.fixture(scope="module")
def photos():
    return [(photograph(camera), camera) for camera in (stand(0), stand(0.4), stand(-0.4))]


def middle(costs):
    return costs[10:-10, 25:-25].reshape(-1, costs.shape[2])


def test_the_true_plane_costs_least(photos):
    costs = middle(compute_costs(*photos[0], photos[1:], INVERSE))
    assert (costs.argmin(axis=1) == TRUE).mean() > 0.95
    assert costs[:, TRUE].mean() < 15
    assert costs[:, TRUE + 5].mean() > 100


def test_brightness_and_contrast_may_differ(photos):
    changed = [(0.5 * photo + 60, camera) for photo, camera in photos[1:]]
    plain, other = (compute_costs(*photos[0], partners, INVERSE) for partners in (photos[1:], changed))
    assert np.abs(middle(plain).astype(int) - middle(other)).mean() < 3


def test_a_partner_that_something_hides_is_outvoted(photos):
    hidden = np.random.default_rng(0).uniform(0, 255, photos[1][0].shape).astype(np.float32)
    costs = middle(compute_costs(*photos[0], [photos[2], (hidden, photos[1][1])], INVERSE))
    assert (costs.argmin(axis=1) == TRUE).mean() > 0.9


def test_what_no_partner_shows_costs_neither_little_nor_much(photos):
    away = Camera(80.0, 80.0, 40.0, 30.0, 80, 60, look_at(np.array([0.4, 0, 0]), np.array([0.4, -10.0, 0])))
    costs = compute_costs(*photos[0], [(photos[1][0], away)], INVERSE)
    assert (costs == UNKNOWN).all()


def test_even_surfaces_match_nothing(photos):
    flat = np.full_like(photos[0][0], 90)
    costs = compute_costs(flat, photos[0][1], [(flat, photos[1][1])], INVERSE)
    assert middle(costs).min() > 200


def test_partners_may_have_other_sizes(photos):
    larger = photos[1][1].resize(120, 90)
    rays = larger.compute_ray_directions()
    hit = larger.position + rays * (5 / rays[..., 1:2])
    photo = read_texture(1, hit[..., 0].ravel(), hit[..., 2].ravel()).reshape(90, 120).astype(np.float32)
    costs = middle(compute_costs(*photos[0], [(photo, larger), photos[2]], INVERSE))
    assert (costs.argmin(axis=1) == TRUE).mean() > 0.9
