"""A row of posts before a wall, passed by a car with two cameras and a LiDAR: photos and sweeps of a few lines."""

from dataclasses import replace

import numpy as np

from instdrive_core.datasets.clip import Clip, Frame, Sweep, SweepPoints, is_held_out
from instdrive_core.scene.camera import Camera, CameraView

WIDTH, HEIGHT, STEPS = 240, 60, 10
WALL = 12.0
RADIUS = 0.35
CAMERAS = ("left", "right")


class PostStreet:
    """Posts on both sides (x = ±5 to 8 m) in random colours, drawn anew from a seed."""

    def __init__(self, seed: int = 0, speed: float = 7.0) -> None:
        rng = np.random.default_rng(seed)
        along = np.arange(-30, 40, 1.9)
        sides = np.where(np.arange(len(along)) % 2, 1, -1)
        self.posts = np.stack([sides * rng.uniform(5, 8, len(along)), along + rng.uniform(-0.5, 0.5, len(along))], 1)
        self.colors = rng.uniform(20, 120, (len(along), 3))
        self.speed = speed

    def cast(self, origin, directions):
        """Distance and post (-1 = wall) that level rays (n, 2) meet first."""
        offset = self.posts - origin
        along = directions @ offset.T
        aside = (offset**2).sum(axis=1) - along**2
        reach = along - np.sqrt(np.maximum(RADIUS**2 - aside, 0))
        reach = np.where((aside < RADIUS**2) & (along > 0), reach, np.inf)
        wall = (WALL - np.sign(directions[:, 0]) * origin[0]) / np.maximum(np.abs(directions[:, 0]), 1e-3)
        nearest = reach.argmin(axis=1)
        first = reach[np.arange(len(directions)), nearest]
        return np.minimum(first, wall), np.where(first < wall, nearest, -1)

    def camera(self, name, step):
        """One camera looks left, one right."""
        side = -1.0 if name == "left" else 1.0
        pose = np.eye(4)
        pose[:3, :3] = np.array([[0.0, -side, 0], [0, 0, -1], [side, 0, 0]]).T
        pose[:3, 3] = [0, 0.1 * self.speed * step, 1.5]
        return Camera(WIDTH / 2, WIDTH / 2, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT, pose)

    def owners(self, camera):
        """Post that each column shows, -1 = wall."""
        x = (np.arange(WIDTH) + 0.5 - camera.cx) / camera.fx
        rays = x[:, None] * camera.world_from_camera[:2, 0] + camera.world_from_camera[:2, 2]
        return self.cast(camera.position[:2], rays / np.linalg.norm(rays, axis=1, keepdims=True))[1]

    def labels(self, camera):
        """Instance map (h, w)."""
        return np.repeat((self.owners(camera) + 2)[None], HEIGHT, axis=0).astype(np.uint16)

    def photo(self, camera):
        """RGB photo; the wall is bright with a little noise."""
        owners = self.owners(camera)
        row = np.where(owners[:, None] < 0, 200.0, self.colors[owners])
        noise = np.random.default_rng(0).normal(0, 4, (HEIGHT, WIDTH, 1))
        return np.clip(row[None] + noise, 0, 255).astype(np.uint8)

    def sweep(self, step, start=0.0):
        """Points of a turn, at heights around the cameras'."""
        origin = np.array([0, 0.1 * self.speed * step])
        angle = np.linspace(-np.pi, np.pi, 1500, endpoint=False)
        rays = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        reach, _ = self.cast(origin, rays)
        level = origin + np.minimum(reach, 60)[:, None] * rays
        points = [np.column_stack([level, np.full(len(level), 1.5 + up)]) for up in np.linspace(-2, 2, 40)]
        cloud = np.concatenate(points).astype(np.float32)
        count = len(cloud)
        times = np.full(count, start + 0.1 * step)
        return SweepPoints(cloud, np.zeros(count, np.float32), np.zeros(count, np.uint8), None, None, times)

    def build_clip(self, path="posts", pose_lag=0, lagging=CAMERAS):
        """The clip; photos of the `lagging` cameras are listed with the poses of `pose_lag` steps later."""
        frames = []
        for step in range(STEPS):
            for name in CAMERAS:
                seen_from = self.camera(name, step)
                listed = self.camera(name, step + pose_lag) if name in lagging else seen_from
                view = CameraView(listed, name, step, 0.1 * step, f"{path}/{name}/{step:02d}.jpg", is_held_out(step))
                frames.append(Frame(view, lambda seen_from=seen_from: self.photo(seen_from)))
        sweeps = tuple(Sweep(step, 0.1 * step, lambda step=step: self.sweep(step)) for step in range(STEPS))
        return Clip(path, "posts", np.zeros(3), tuple(frames), sweeps, (), {}, CAMERAS)


def drop_steps(clip, steps):
    """The clip without photos and sweeps of some steps."""
    frames = tuple(frame for frame in clip.frames if frame.view.index not in steps)
    return replace(clip, frames=frames, sweeps=tuple(sweep for sweep in clip.sweeps if sweep.index not in steps))
