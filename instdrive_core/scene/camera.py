"""Pinhole cameras in OpenCV axes (x right, y down, z forward); pixel centres lie at +0.5."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from numpy import ndarray

from instdrive_core.maths.vectors import Vector, to_vector


@dataclass(frozen=True)
class PhotoLag:
    """How much later than a turning LiDAR a photo shows things, by their direction from it.

    Boxes of a time step stand where the LiDAR met their objects, at an instant of its own for each direction; a photo
    shows them all at one instant. Two photos of a step may show the same car half a metre apart.
    """

    center: Vector
    """Where the LiDAR stands, metres in the scene."""
    start: Vector
    """Unit direction in which its turn began."""
    left: Vector
    """Unit direction a quarter turn counterclockwise of it, seen from above."""
    turn: float
    """Seconds of a whole turn; negative = clockwise."""
    began: float
    """When the turn began, seconds after the time step; often negative."""
    taken: float
    """When the photo was taken, likewise."""

    def find(self, place: Float[ndarray, "3"]) -> float:
        """Find the seconds by which the photo shows what is at `place` later than the LiDAR met it there."""
        away = place - np.array(self.center)
        turned = np.sign(self.turn) * np.arctan2(away @ np.array(self.left), away @ np.array(self.start))
        return self.taken - self.began - abs(self.turn) * float(turned / (2 * np.pi) % 1.0)

    def transform(self, matrix: Float64[ndarray, "3 4"]) -> PhotoLag:
        """Transform it by [s R | t], with the scene."""
        center = matrix[:, :3] @ self.center + matrix[:, 3]
        start, left = (matrix[:, :3] @ side / np.linalg.norm(matrix[:, 0]) for side in (self.start, self.left))
        return replace(self, center=to_vector(center), start=to_vector(start), left=to_vector(left))

    @staticmethod
    def look_from(center: Float[ndarray, "3"], start: float, turn: float, began: float, taken: float) -> PhotoLag:
        """Build it of a LiDAR that stands upright and begins to turn in the direction `start`, radians from x."""
        x, y = float(np.cos(start)), float(np.sin(start))
        return PhotoLag(to_vector(center), (x, y, 0.0), (-y, x, 0.0), turn, began, taken)


@dataclass(frozen=True)
class Camera:
    """A posed pinhole camera."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    world_from_camera: Float64[ndarray, "4 4"]
    """Rigid, relative to the scene's origin (metres)."""
    lag: PhotoLag | None = None
    """How much later a photo shows things; None = it shows where they are at the time step."""

    @property
    def camera_from_world(self) -> Float64[ndarray, "4 4"]:
        """The inverse of `world_from_camera`."""
        rotation, position = self.world_from_camera[:3, :3], self.world_from_camera[:3, 3]
        inverse = np.eye(4)
        inverse[:3, :3] = rotation.T
        inverse[:3, 3] = -rotation.T @ position
        return inverse

    @property
    def position(self) -> Float64[ndarray, "3"]:
        """Camera centre in the world."""
        return self.world_from_camera[:3, 3]

    @property
    def intrinsics(self) -> Float64[ndarray, "3 3"]:
        """The intrinsic matrix K, in pixels."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    def resize(self, width: int, height: int) -> Camera:
        """Return this view with another picture size in pixels."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self, fx=self.fx * sx, fy=self.fy * sy, cx=self.cx * sx, cy=self.cy * sy, width=width, height=height
        )

    def scale(self, factor: float) -> Camera:
        """Return this view at `factor` times the resolution, rounded to whole pixels."""
        return self.resize(max(1, round(self.width * factor)), max(1, round(self.height * factor)))

    def crop(self, left: int, top: int, right: int, bottom: int) -> Camera:
        """Return the camera of a part of this view, whose edges are given in pixels; right and bottom are outside."""
        return replace(self, cx=self.cx - left, cy=self.cy - top, width=right - left, height=bottom - top)

    def find_edge_slopes(self, margin: float) -> tuple[float, float, float, float]:
        """Find x / z and y / z at the picture's left, top, right and bottom edge, `margin` pixels farther out."""
        left, right = (-margin - self.cx) / self.fx, (self.width + margin - self.cx) / self.fx
        top, bottom = (-margin - self.cy) / self.fy, (self.height + margin - self.cy) / self.fy
        return left, top, right, bottom

    def contains(
        self, pixels: Float64[ndarray, "n 2"], depths: Float64[ndarray, " n"], nearest: float
    ) -> Bool[ndarray, " n"]:
        """Tell which projected points are in the picture and farther than `nearest` metres."""
        return (depths > nearest) & ((pixels >= 0) & (pixels < [self.width, self.height])).all(axis=1)

    def project(self, points: Float[ndarray, "n 3"]) -> tuple[Float64[ndarray, "n 2"], Float64[ndarray, " n"]]:
        """Project world points to pixel coordinates and depths (z, metres); pixels of points at z ≤ 0 mean nothing."""
        matrix = self.camera_from_world
        local = points @ matrix[:3, :3].T
        depth = local[:, 2] + matrix[2, 3]
        safe = np.where(np.abs(depth) > 1e-9, depth, 1e-9)
        pixels = np.empty((len(points), 2))
        # A column at a time: NumPy walks rows of two or three numbers slowly.
        for column, (focal, center) in enumerate(((self.fx, self.cx), (self.fy, self.cy))):
            pixels[:, column] = (local[:, column] + matrix[column, 3]) / safe * focal + center
        return pixels, depth

    def compute_ray_directions(self) -> Float64[ndarray, "h w 3"]:
        """Compute the unit viewing directions in the world through all pixel centres."""
        pixels = np.arange(self.width * self.height)
        return self.compute_pixel_rays(pixels).reshape(self.height, self.width, 3)

    def compute_pixel_rays(self, pixels: Int[ndarray, " p"]) -> Float64[ndarray, "p 3"]:
        """Compute unit viewing directions in the world through pixels' centres, given flat row-major indices."""
        rows = pixels // self.width
        x = (pixels - rows * self.width + 0.5 - self.cx) / self.fx
        y = (rows + 0.5 - self.cy) / self.fy
        local = np.stack([x, y, np.ones(len(pixels))], axis=-1)
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        return local @ self.world_from_camera[:3, :3].T


def build_edge_normals(left: float, top: float, right: float, bottom: float) -> Float64[ndarray, "4 3"]:
    """Build the unit inner normals, in camera axes, of the planes through a camera and a picture's edges, by slopes."""
    normals = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]], np.float64)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def look_at(position: Float[ndarray, "3"], target: Float[ndarray, "3"]) -> Float64[ndarray, "4 4"]:
    """Compute world_from_camera of a camera at `position` that looks at `target`, world z up."""
    up = np.array([0.0, 0.0, 1.0])
    forward = np.asarray(target, float) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-6:
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


@dataclass(frozen=True)
class CameraView:
    """One photo's camera: what the editor's dataset cameras and the timeline show."""

    camera: Camera
    name: str
    """Camera name, e.g. ``front_camera``."""
    index: int
    """Time step of the clip."""
    time: float
    """Seconds since the clip's first time step."""
    photo: str = ""
    """Path of the photo; empty where there is none."""
    held_out: bool = False
