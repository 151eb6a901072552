"""A street of three surfaces, known exactly: road, a wall, a car, and the sky above; LiDAR up to 15 degrees."""

import numpy as np

from instdrive_core.datasets.clip import Clip, Frame, Sweep, SweepPoints, is_held_out
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.track import Track

WIDTH, HEIGHT = 160, 90
ROAD, WALL, CAR, SKY = 7, 41, 13, 0
"""What `truth` holds: semantic classes, 0 for the sky."""
CLASSES = {7: "Road", 8: "Lane Line Marking", 13: "Car", 30: "Pedestrian", 41: "Building"}
COLORS = {ROAD: (90, 90, 95), WALL: (150, 80, 60), CAR: (30, 35, 60), SKY: (170, 200, 235)}
WALL_Y, WALL_TOP = 25.0, 4.0
CAR_SIZE = np.array([2.0, 4.0, 1.5])
CAR_SPEED = 5.0


def car_center(time: float) -> np.ndarray:
    """Where the car is."""
    return np.array([-1.0 + CAR_SPEED * time, 12.0, 0.75])


def camera() -> Camera:
    """Looks along y from 1.6 m."""
    return Camera(120.0, 120.0, 80.0, 45.0, WIDTH, HEIGHT, look_at(np.array([0, 0, 1.6]), np.array([0, 10, 1.6])))


def truth(time: float) -> np.ndarray:
    """The class that each pixel shows (h, w)."""
    view = camera()
    rays = view.compute_ray_directions()
    labels = np.where(rays[..., 2] < 0, ROAD, SKY)
    distance = np.where(rays[..., 2] < 0, -1.6 / np.minimum(rays[..., 2], -1e-9), np.inf)
    to_wall = WALL_Y / rays[..., 1]
    on_wall = (to_wall < distance) & (1.6 + to_wall * rays[..., 2] < WALL_TOP)
    labels[on_wall], distance[on_wall] = WALL, to_wall[on_wall]
    near, far = np.full(rays.shape[:2], -np.inf), np.full(rays.shape[:2], np.inf)
    for axis in range(3):
        one = (car_center(time) - CAR_SIZE / 2 - view.position)[axis] / rays[..., axis]
        other = (car_center(time) + CAR_SIZE / 2 - view.position)[axis] / rays[..., axis]
        near, far = np.maximum(near, np.minimum(one, other)), np.minimum(far, np.maximum(one, other))
    labels[(near < far) & (near < distance)] = CAR
    return labels


def photo(time: float) -> np.ndarray:
    """The photo (h, w, 3), with some noise."""
    labels = truth(time)
    image = np.zeros((HEIGHT, WIDTH, 3))
    for label, color in COLORS.items():
        image[labels == label] = color
    return np.clip(image + np.random.default_rng(0).normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def sweep(time: float) -> SweepPoints:
    """What a LiDAR sees, too sparse for a dense picture by itself."""
    rng = np.random.default_rng(int(time * 10))
    road = np.column_stack([rng.uniform(-20, 20, 12000), rng.uniform(1, WALL_Y, 12000), np.zeros(12000)])
    wall = np.column_stack([rng.uniform(-22, 22, 9000), np.full(9000, WALL_Y), rng.uniform(0, WALL_TOP, 9000)])
    car = rng.uniform(-0.5, 0.5, (600, 3)) * CAR_SIZE
    faces = rng.integers(0, 2, 600)  # the side that faces the camera, and the roof
    car[faces == 0, 1] = -CAR_SIZE[1] / 2
    car[faces == 1, 2] = CAR_SIZE[2] / 2
    car += car_center(time)
    inside = (np.abs(road - car_center(time))[:, :2] < CAR_SIZE[:2] / 2).all(axis=1)
    road = road[~inside]
    points = np.concatenate([road, wall, car]).astype(np.float32)
    classes = np.repeat([ROAD, WALL, CAR], [len(road), len(wall), len(car)]).astype(np.uint8)
    classes[: len(road)][np.abs(road[:, 0]) < 0.2] = 8
    return SweepPoints(points, np.zeros(len(points), np.float32), np.zeros(len(points), np.uint8), classes)


def painted_clip(path: str, steps: range = range(2, 6)) -> Clip:
    """One camera, a sweep in each step."""
    times = {step: 0.1 * step for step in steps}
    frames = tuple(
        Frame(
            CameraView(camera(), "front_camera", step, time, held_out=is_held_out(step)),
            lambda time=time: photo(time),
        )
        for step, time in times.items()
    )
    sweeps = tuple(Sweep(step, time, lambda time=time: sweep(time)) for step, time in times.items())
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, 3] = [car_center(time) for time in times.values()]
    # x is the car's width and y its length
    track = Track("the-car", "Car", CAR_SIZE, np.array(list(times.values())), poses, moving=True)
    return Clip(path, "painted", np.zeros(3), frames, sweeps, (track,), CLASSES, ("front_camera",))
