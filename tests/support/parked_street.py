"""A street with a parked car, and the same street without it: the ground that the car hides is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

ROAD, PAVEMENT, WALL, CAR, OTHER_CAR = 1, 2, 3, 7, 8
KERB = 0.14
"""Metres that the pavement (x > 3) is higher than the road."""
CAR_CENTER = np.array([2.0, 0.0, 0.75])
CAR_SIZE = np.array([1.8, 4.2, 1.5])
NAMES = {ROAD: "road", PAVEMENT: "pavement", WALL: "wall", CAR: "Car 7", OTHER_CAR: "Car 8"}


@dataclass(frozen=True)
class ParkedStreet:
    """Two scenes of the same rows up to `len(empty)`."""

    scene: Scene
    """The car on ground as training leaves it: nothing or dark noise beneath the car, strays in it."""
    empty: Scene
    """No car, whole ground."""
    strays: np.ndarray
    """Rows of `scene` that float inside the car under other labels."""


def ground_color(places):
    """Asphalt with a white line at x = 0.9 and light paving stones."""
    color = np.where(places[:, :1] > 3, [0.66, 0.63, 0.58], [0.33, 0.33, 0.35])
    line = np.abs(places[:, 0] - 0.9) < 0.1
    return np.where(line[:, None], [0.9, 0.9, 0.88], color)


def parked_street(views: bool = True, seed: int = 5, wall_top: float = 3.5) -> ParkedStreet:
    """About 12,000 Gaussians; `views` = false leaves the cameras out; the wall is `wall_top` metres high."""
    rng = np.random.default_rng(seed)
    ground, ground_ids = _ground(rng)
    wall = np.stack(np.meshgrid([6.0], np.arange(-12, 12, 0.2), np.arange(0.3, wall_top, 0.2)), axis=-1).reshape(-1, 3)
    cars = [_shell(rng, 1500, center) for center in (CAR_CENTER, CAR_CENTER + np.array([0, 6.5, 0]))]
    standing = [wall, cars[1]]
    standing_ids = np.repeat([WALL, OTHER_CAR], [len(part) for part in standing])
    standing_colors = np.repeat([[0.6, 0.4, 0.3], [0.7, 0.7, 0.1]], [len(part) for part in standing], axis=0)
    cameras = _views() if views else ()
    colors = np.concatenate([ground_color(ground), standing_colors])
    means, ids = np.concatenate([ground, *standing]), np.concatenate([ground_ids, standing_ids])
    empty = scene_of(rng, means, ids, colors, cameras)

    hidden = (np.abs(ground[:, :2] - CAR_CENTER[:2]) < CAR_SIZE[:2] / 2).all(axis=1)
    noise = CAR_CENTER + rng.uniform(-0.5, 0.5, (120, 3)) * [*CAR_SIZE[:2], 0] - [0, 0, 1.3]
    strays = CAR_CENTER + rng.uniform(-0.3, 0.3, (40, 3)) * CAR_SIZE
    kept = np.concatenate([~hidden, np.ones(len(standing_ids), bool)])
    parts = [(cars[0], CAR, [0.7, 0.1, 0.1]), (noise, ROAD, [0.05, 0.02, 0.02]), (strays, PAVEMENT, [0.4, 0.5, 0.8])]
    scene = scene_of(
        rng,
        np.concatenate([means[kept], *(points for points, _, _ in parts)]),
        np.concatenate([ids[kept], *(np.full(len(points), number) for points, number, _ in parts)]),
        np.concatenate([colors[kept], *(np.tile(color, (len(points), 1)) for points, _, color in parts)]),
        cameras,
    )
    return ParkedStreet(scene, empty, np.arange(len(scene) - len(strays), len(scene)))


def scene_of(rng, means, ids, colors, views) -> Scene:
    """Small solid splats, flat on the ground."""
    count = len(means)
    scales = np.where(np.isin(ids, (ROAD, PAVEMENT))[:, None], [0.08, 0.08, 0.015], [0.09, 0.09, 0.09])
    gaussians = Gaussians(
        means.astype(np.float32),
        np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        np.log(scales).astype(np.float32),
        logit(np.full(count, 0.9)).astype(np.float32),
        dc_from_color(np.clip(colors * (1 + rng.normal(0, 0.04, (count, 1))), 0, 1)).astype(np.float32),
        rng.normal(0, 0.01, (count, 3, 3)).astype(np.float32),
        np.zeros((count, 0), np.float32),
    )
    ids = ids.astype(np.uint32)
    zeros = np.zeros(count, np.uint32)
    table = build_instance_table(ids, gaussians.means, zeros, None, NAMES, {CAR: "Car", OTHER_CAR: "Car"})
    return Scene(gaussians, ids, zeros, np.zeros(count, np.uint16), table, views=views)


def _ground(rng):
    x, y = np.meshgrid(np.arange(-4, 6, 0.14), np.arange(-12, 12, 0.14))
    places = np.stack([x.ravel(), y.ravel()], axis=1) + rng.normal(0, 0.015, (x.size, 2))
    on_pavement = places[:, 0] > 3
    heights = np.where(on_pavement, KERB, 0) + 0.02 * places[:, 1] + rng.normal(0, 0.004, len(places))
    return np.c_[places, heights], np.where(on_pavement, PAVEMENT, ROAD)


def _shell(rng, count, center):
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis]) / 2
    return points * CAR_SIZE + center + [0, 0, 0.02 * center[1]]


def _views():
    """A car drives by in the left lane and looks ahead and to the right."""
    views = []
    for index in range(12):
        eye = np.array([-2.0, -9.0 + 1.5 * index, 1.8 + 0.02 * (-9.0 + 1.5 * index)])
        for name, aim in (("front_camera", [2.5, 8.0, -1.3]), ("right_camera", [5.0, 1.0, -1.7])):
            camera = Camera(300.0, 300.0, 200.0, 120.0, 400, 240, look_at(eye, eye + aim))
            views.append(CameraView(camera, name, index, 0.1 * index))
    return tuple(views)
