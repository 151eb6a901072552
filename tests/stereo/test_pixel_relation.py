"""A pixel goes where its point is seen from the other camera, and comes back."""

import numpy as np

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.stereo.pixel_relation import carry_over, relate_pixels


def test_places_are_those_of_the_points_they_show():
    rng = np.random.default_rng(0)
    first = Camera(200.0, 210.0, 100.0, 60.0, 200, 120, look_at(np.zeros(3), np.array([1.0, 9, 0.2])))
    second = Camera(150.0, 150.0, 90.0, 70.0, 160, 140, look_at(np.array([1.0, -0.5, 0.3]), np.array([0.0, 9, 0])))
    points = np.array([0, 8.0, 0]) + rng.uniform(-2, 2, (50, 3))
    ((here, depths), (there, beyond)) = first.project(points), second.project(points)
    there_and_back = relate_pixels(first, second), relate_pixels(second, first)
    for (u, v), depth, (x, y), other in zip(here, depths, there, beyond, strict=True):
        found = carry_over(*there_and_back[0], u, v, 1 / depth)
        np.testing.assert_allclose(found, (x, y, other / depth), rtol=1e-9)
        np.testing.assert_allclose(carry_over(*there_and_back[1], x, y, 1 / other)[:2], (u, v), rtol=1e-9)
