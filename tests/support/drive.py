"""A drive in memory: flat grey ground, one red box that moves, one blue box that is parked."""

import numpy as np

from instdrive_core.datasets.clip import Clip, Frame, Sweep, SweepPoints, is_held_out
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.track import Track

SIZE = np.array([2.0, 4.0, 1.5])
STEPS = (3, 4, 5, 6)
ROAD, CAR = 7, 13


def track(name: str, x: float, speed: float) -> Track:
    times = np.array([0.1 * step for step in STEPS])
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, 3] = [[x, 10 + speed * time, 0.75] for time in times]
    return Track(name, "Car", SIZE, times, poses, moving=speed > 0)


def box_points(pose: np.ndarray, rng: np.random.Generator, count: int) -> np.ndarray:
    local = rng.uniform(-0.5, 0.5, (count, 3))
    local[:, 2] = np.abs(local[:, 2]) * 0.9 + 0.05
    local[:, 0] = np.sign(local[:, 0]) * 0.5
    return (local * SIZE) @ pose[:3, :3].T + pose[:3, 3]


def drive() -> Clip:
    moving, parked = track("moving", -2.0, 20.0), track("parked", 2.5, 0.0)
    rng = np.random.default_rng(0)
    sweeps, frames = [], []
    for step in STEPS:
        time = 0.1 * step
        ground = np.stack([rng.uniform(-6, 6, 3000), rng.uniform(4, 25, 3000), np.zeros(3000)], axis=1)
        cars = [box_points(t.interpolate_pose(time), rng, 400) for t in (moving, parked)]
        points = np.concatenate([ground, *cars]).astype(np.float32)
        classes = np.repeat([ROAD, CAR, CAR], [3000, 400, 400]).astype(np.uint8)
        loaded = SweepPoints(points, np.zeros(len(points), np.float32), np.zeros(len(points), np.uint8), classes)
        sweeps.append(Sweep(step, time, lambda loaded=loaded: loaded))
        camera = Camera(80.0, 80.0, 60.0, 40.0, 120, 80, look_at(np.array([0, 0, 1.6]), np.array([0, 10.0, 0.8])))
        view = CameraView(camera, "front_camera", step, time, "", is_held_out(step))
        image = np.full((80, 120, 3), 128, np.uint8)
        frames.append(Frame(view, lambda image=image: image))
    return Clip(
        "a drive in memory",
        "drive",
        np.zeros(3),
        tuple(frames),
        tuple(sweeps),
        (moving, parked),
        {ROAD: "Road", CAR: "Car"},
        ("front_camera",),
    )
