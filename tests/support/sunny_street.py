"""A street in the sun between houses whose roofs no photo shows, with a parked car."""

from __future__ import annotations

import numpy as np
from parked_street import CAR, OTHER_CAR, PAVEMENT, ROAD, WALL, scene_of

from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.scene import Scene

SUN = np.array([0.8, 0.6, 1.1])
"""Towards the sun; x is across the street, y along."""
FRONT, KERB_LINE, HALF_LENGTH = 8.0, 5.0, 30.0
CAR_PLACE, OTHER_PLACE = np.array([3.9, 5.0, 0.75]), np.array([-2.4, -2.0, 0.75])
CAR_HALF = np.array([0.9, 2.1, 0.75])
SEEN_TOP = 3.6
"""Metres up to which photos show the houses."""
DIMMED = 0.4


def tell_height(along):
    """Metres: a low house between two taller ones, on the sunny side of the street."""
    return np.where(along < -6, 8.0, np.where(along < 3, 4.0, 5.8))


def find_shaded(places, cars=(CAR_PLACE, OTHER_PLACE)):
    """Which places (n, 2) lie in the shade of the houses or of cars."""
    shaded = np.zeros(len(places), bool)
    for step in np.arange(0.1, 20, 0.1):
        there = places + step * SUN[:2]
        height = step * SUN[2]
        shaded |= (there[:, 0] >= FRONT) & (there[:, 0] < FRONT + 10) & (tell_height(there[:, 1]) > height)
        for car in cars:
            inside = (np.abs(there - car[:2]) < CAR_HALF[:2]).all(axis=1)
            shaded |= inside & (height < 2 * CAR_HALF[2])
    return shaded


def sunny_street(shade: bool = True) -> Scene:
    """About 50,000 Gaussians; `shade` = false puts clouds before the sun."""
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.arange(-FRONT, FRONT, 0.17), np.arange(-HALF_LENGTH, HALF_LENGTH, 0.17))
    places = np.c_[x.ravel(), y.ravel()] + rng.normal(0, 0.02, (x.size, 2))
    raised = np.abs(places[:, 0]) > KERB_LINE
    color = np.where(raised[:, None], [0.7, 0.68, 0.64], [0.45, 0.44, 0.43])
    color = color * np.where(find_shaded(places) & shade, DIMMED, 1.0)[:, None]
    ground = np.c_[places, np.where(raised, 0.14, 0.0)]
    fronts = [
        np.stack(np.meshgrid([side], np.arange(-HALF_LENGTH, HALF_LENGTH, 0.2), np.arange(0.2, SEEN_TOP, 0.2)), -1)
        for side in (-FRONT, FRONT)
    ]
    wall = np.concatenate([front.reshape(-1, 3) for front in fronts])
    cars = [_build_shell(rng, place) for place in (CAR_PLACE, OTHER_PLACE)]
    means = np.concatenate([ground, wall, *cars])
    ids = np.concatenate(
        [np.where(raised, PAVEMENT, ROAD), np.full(len(wall), WALL), np.full(len(cars[0]), CAR),
         np.full(len(cars[1]), OTHER_CAR)]
    )  # fmt: skip
    colors = np.concatenate([color, np.tile([0.6, 0.4, 0.3], (len(means) - len(color), 1))])
    return scene_of(rng, means, ids, colors, _list_views())


def _build_shell(rng, place):
    points = rng.uniform(-1, 1, (1500, 3))
    points[np.arange(1500), rng.integers(0, 3, 1500)] = rng.choice([-1, 1], 1500)
    return points * CAR_HALF + place


def _list_views():
    views = []
    for index in range(12):
        eye = np.array([0.0, -9.0 + 1.5 * index, 1.8])
        for name, aim in (
            ("front", [0, 8, -1.5]),
            ("back", [0, -8, -1.5]),
            ("right", [8, 0, -2]),
            ("left", [-8, 0, -2]),
        ):
            camera = Camera(250.0, 250.0, 200.0, 120.0, 400, 240, look_at(eye, eye + np.array(aim, float)))
            views.append(CameraView(camera, name, index, 0.1 * index))
    return tuple(views)
