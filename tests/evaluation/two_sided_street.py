"""A road between two facades of one class, a parked car on it: annotated by LiDAR classes and one cuboid, no more."""

from __future__ import annotations

import numpy as np
from evaluation_scene import box_surface

from instdrive_core.datasets.clip import Clip, Frame, Sweep, SweepPoints, is_held_out
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track

ROAD, WALL, CAR = 7, 41, 13
CLASSES = {ROAD: "Road", WALL: "Building", CAR: "Car"}
COLORS = {ROAD: (0.3, 0.3, 0.3), WALL: (0.7, 0.4, 0.3), CAR: (0.1, 0.1, 0.7)}
SIZE, MIDDLE = np.array([2.0, 4.0, 1.6]), np.array([1.5, 11.0, 0.8])
WIDTH, HEIGHT = 160, 90


def surface_points() -> tuple[np.ndarray, np.ndarray]:
    """All surfaces, 0.15 m apart, and the class of each point."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-5.9, 5.9, 0.15), np.arange(2, 24, 0.15)))
    on_road = np.stack([x, y, np.zeros(x.size)], -1)
    under_car = (np.abs(on_road - MIDDLE)[:, :2] < SIZE[:2] / 2).all(axis=1)
    along, up = (axis.ravel() for axis in np.meshgrid(np.arange(2, 24, 0.15), np.arange(0, 4, 0.15)))
    walls = [np.stack([np.full(along.size, side), along, up], -1) for side in (-6.0, 6.0)]
    parts = {ROAD: on_road[~under_car], WALL: np.concatenate(walls), CAR: box_surface(SIZE) + MIDDLE}
    classes = np.repeat(list(parts), [len(part) for part in parts.values()]).astype(np.uint8)
    return np.concatenate(list(parts.values())).astype(np.float32), classes


def two_sided_scene() -> Scene:
    """The surfaces as Gaussians that all have one ID."""
    points, classes = surface_points()
    count = len(points)
    gaussians = Gaussians(
        means=points,
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.full((count, 3), np.log(0.08), np.float32),
        opacity_logits=logit(np.full(count, 0.95, np.float32)),
        sh_dc=dc_from_color(np.array([COLORS[each] for each in classes.tolist()], np.float32)).astype(np.float32),
        sh_rest=np.zeros((count, 0, 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )
    ids, nodes = np.ones(count, np.uint32), np.zeros(count, np.uint16)
    table = build_instance_table(ids, points, ids, nodes)
    sky = Sky(np.full((6, 2, 2, 3), 0.8, np.float32))
    return Scene(gaussians, ids, np.zeros(count, np.uint32), nodes, table, (), sky, ())


def two_sided_clip() -> Clip:
    """Three time steps of one camera, each with a sweep; step 4 is held out."""
    points, classes = surface_points()
    found = SweepPoints(points, np.zeros(len(points), np.float32), np.zeros(len(points), np.uint8), classes)
    pose = np.eye(4)
    pose[:3, 3] = MIDDLE
    times = {index: index / 10 for index in (3, 4, 5)}
    frames = []
    for index, time in times.items():
        at = look_at(np.array([0, 0.1 * index, 1.8]), np.array([0, 12.0, 1.2]))
        camera = Camera(110.0, 110.0, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT, at)
        view = CameraView(camera, "front", index, time, held_out=is_held_out(index))
        frames.append(Frame(view, lambda camera=camera: draw_photo(camera)))
    sweeps = tuple(Sweep(index, time, lambda: found) for index, time in times.items())
    track = Track("the-car", "Car", SIZE, np.array(list(times.values())), np.stack([pose] * 3))
    return Clip("street", "street", np.zeros(3), tuple(frames), sweeps, (track,), CLASSES, ("front",))


def draw_photo(camera: Camera) -> np.ndarray:
    """The surfaces' points as far-to-near squares before a bright sky."""
    points, classes = surface_points()
    pixels, depths = camera.project(points)
    image = np.full((HEIGHT, WIDTH, 3), 230, np.uint8)
    for number in np.argsort(-depths):
        if depths[number] < 0.3:
            continue
        half = max(1, round(0.1 * camera.fx / depths[number]))
        column, row = np.floor(pixels[number]).astype(int)
        window = slice(max(0, row - half), max(0, row + half)), slice(max(0, column - half), max(0, column + half))
        image[window] = np.array(COLORS[int(classes[number])]) * 255
    return image
