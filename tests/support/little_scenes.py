"""Handfuls of Gaussians in front of a small camera."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from instdrive_core.scene.camera import Camera, look_at


@dataclass
class Splats:
    """Arguments of `render`, in order."""

    means: np.ndarray
    quats: np.ndarray
    log_scales: np.ndarray
    opacities: np.ndarray
    channels: np.ndarray

    def __len__(self) -> int:
        return len(self.means)

    def arrays(self) -> list[np.ndarray]:
        return [getattr(self, entry.name) for entry in fields(self)]

    def joined(self, other: Splats) -> Splats:
        return Splats(*(np.concatenate(pair) for pair in zip(self.arrays(), other.arrays(), strict=True)))


def small_camera(width: int = 53, height: int = 37) -> Camera:
    """Sizes that are no multiple of 16, principal point off the centre, turned and tilted."""
    pose = look_at(np.array([1.0, -2.0, 1.5]), np.array([6.0, 0.5, 0.8]))
    return Camera(0.8 * width, 0.85 * width, 0.47 * width, 0.55 * height, width, height, pose)


def in_view(camera: Camera, pixels: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """World points that project to `pixels` at `depths`."""
    local = np.concatenate([(pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones((len(pixels), 1))], 1)
    local *= np.asarray(depths)[:, None]
    pose = camera.world_from_camera
    return (local @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)


def random_splats(camera: Camera, count: int, channels: int, seed: int, opacity: tuple = (0.05, 0.95)) -> Splats:
    """Splats of a few pixels, flat and turned, over the image and a little beyond it."""
    rng = np.random.default_rng(seed)
    size = np.array([camera.width, camera.height])
    pixels = rng.uniform(-0.15, 1.15, (count, 2)) * size
    depths = rng.uniform(2, 9, count)
    scales = depths[:, None] / camera.fx * np.exp(rng.normal(1.2, 0.5, (count, 1))) * rng.uniform(0.15, 1, (count, 3))
    quats = rng.normal(size=(count, 4)) * rng.uniform(0.5, 2, (count, 1))
    return Splats(
        in_view(camera, pixels, depths),
        quats.astype(np.float32),
        np.log(scales).astype(np.float32),
        rng.uniform(*opacity, count).astype(np.float32),
        rng.uniform(-1, 1, (count, channels)).astype(np.float32),
    )


def plain_splats(
    camera: Camera, pixels: list, depths: list, radius: float, opacity: float, channels: int = 3
) -> Splats:
    """Round splats of `radius` pixels at given pixels; their first channel counts 1, 2, 3 …"""
    count = len(pixels)
    means = in_view(camera, np.array(pixels, float).reshape(-1, 2), np.array(depths, float))
    scales = np.repeat(radius * np.abs(np.array(depths, float))[:, None] / camera.fx, 3, axis=1)
    values = np.zeros((count, channels), np.float32)
    values[:, :1] = np.arange(1, count + 1)[:, None]
    return Splats(
        means,
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        np.log(scales).astype(np.float32),
        np.full(count, opacity, np.float32),
        values,
    )
