"""Guessing which way is up in a scene: from the photos' cameras, else from the ground that its flat splats make.

The ground is a thin layer of splats that lie flat in it, with hardly anything below: of a wall, the other flat thing in
a street, there is as much on both sides, or another one opposite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int64
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.upright import UP, Axis, direction_of, nearest_axis

LOOKED_AT = 40_000
"""Splats that decide, evenly chosen."""
SNAP = 3.0
"""Degrees from an axis below which the axis is meant."""
_LEVEL = 0.7
"""Length of the mean of the cameras' ups above which they agree."""
_FAINT = 0.1
"""Opacity below which splats make no ground."""
_ALIGNED = np.cos(np.radians(15.0))
"""How well a splat's normal must agree with a plane's to lie in it."""
_APART = np.cos(np.radians(35.0))
"""Planes that are closer than this are one plane, seen twice."""
_LAYERS = 64
_SURE, _SURER_THAN_OTHERS = 0.08, 2.0
"""Share of all area that the ground must have, and how many times that of anything else that might be the ground."""
_CUSTOM: Axis = "-y"
"""Up in files of most other programs, whose axes are those of a photo's camera: right, down, forward."""


@dataclass(frozen=True)
class UpEstimate:
    """A guess, and how it was made."""

    direction: Float64[ndarray, "3"]
    """Unit vector in the scene's axes; exactly an axis where it is within `SNAP` of one."""
    confident: bool
    """Whether it is worth telling without being asked."""
    reason: str
    """How it is known, e.g. ``the photos' cameras``."""

    @property
    def axis(self) -> Axis:
        """The nearest axis."""
        return nearest_axis(self.direction)[0]

    @property
    def tilt(self) -> float:
        """Degrees from that axis; 0 where it is meant exactly."""
        return nearest_axis(self.direction)[1]


@dataclass(frozen=True)
class _Surfaces:
    """Splats as pieces of surfaces, weighted by what they cover, the more the flatter they are."""

    means: Float64[ndarray, "n 3"]
    normals: Float64[ndarray, "n 3"]
    areas: Float64[ndarray, " n"]
    """Relative; they sum to 1."""
    flat_areas: Float64[ndarray, " n"]
    """Areas times flatness, of the same total."""


def estimated_up(scene: Scene, stated: Axis | None = None) -> UpEstimate:
    """Which way is up in a scene; `stated` is what its file's format says, in this program's axes.

    Cameras are believed first, then a clear ground, then the format. What has instances was made by this program, and
    has z up; else the most common axis is given, without confidence.
    """
    cameras = _up_of_cameras(scene.views)
    if cameras is not None:
        return UpEstimate(_snapped(cameras), True, "the photos' cameras")
    ground = up_of_splats(scene.gaussians, np.flatnonzero(scene.nodes == 0))
    if ground is not None:
        return UpEstimate(_snapped(ground), True, "the ground")
    if stated is not None:
        return UpEstimate(direction_of(stated), True, "the file's format")
    return UpEstimate(direction_of(UP if len(scene.table) else _CUSTOM), False, "custom")


def up_of_splats(gaussians: Gaussians, rows: Int64[ndarray, " k"]) -> Float64[ndarray, "3"] | None:
    """Unit normal, upwards, of the ground that these rows make; None where no plane is clearly the ground."""
    surfaces = _surfaces_of(gaussians.select(rows[:: 1 + len(rows) // LOOKED_AT]))
    if surfaces is None:
        return None
    found = sorted((_ground_of(surfaces, normal) for normal in _plane_normals(surfaces)), key=lambda pair: -pair[0])
    (score, up), others = found[0], found[1:]
    apart = [other for other, normal in others if abs(normal @ up) < _APART]
    return up if score >= _SURE and score >= _SURER_THAN_OTHERS * max(apart, default=0.0) else None


def _up_of_cameras(views: Sequence[CameraView]) -> Float64[ndarray, "3"] | None:
    """Level across all pictures: what no camera's x axis points along, on the side of their tops.

    Cameras that look down all the same, e.g. from a drone that went in circles, have tops that lean in every direction.
    """
    if not views:
        return None
    poses = np.stack([view.camera.world_from_camera for view in views])
    mean = -poses[:, :3, 1].mean(axis=0)
    if np.linalg.norm(mean) < _LEVEL * 0.5:
        return None
    sizes, axes = np.linalg.eigh(poses[:, :3, 0].T @ poses[:, :3, 0] / len(views))
    if sizes[1] - sizes[0] > 0.1:  # they look in more than one direction
        level = axes[:, 0] * np.sign(axes[:, 0] @ mean)
        return level if level @ mean > 0.3 else None
    return mean / np.linalg.norm(mean) if np.linalg.norm(mean) > _LEVEL else None


def _surfaces_of(part: Gaussians) -> _Surfaces | None:
    """Of the splats that count: finite, not faint, in the middle 98 % along each axis. None for fewer than 200."""
    finite = [np.isfinite(array).all(axis=1) for array in (part.means, part.quats, part.log_scales)]
    part = part.select(np.logical_and.reduce([*finite, part.opacities > _FAINT]))
    if len(part) < 200:
        return None
    low, high = np.percentile(part.means, [1, 99], axis=0)
    part = part.select(((part.means >= low) & (part.means <= high)).all(axis=1))
    means = part.means.astype(np.float64)
    scales, rotations = part.scales.astype(np.float64), matrix_from_quaternion(part.quats.astype(np.float64))
    normals = np.take_along_axis(rotations, scales.argmin(axis=1)[:, None, None], axis=2)[:, :, 0]
    thin, middle, wide = np.sort(scales, axis=1).T
    areas = middle * wide * part.opacities
    areas = np.minimum(areas, np.quantile(areas, 0.98))  # a few giants, often of sky, are no ground
    flat = areas * (1 - thin / np.maximum(middle, 1e-30)) ** 2
    if not flat.sum() > 0:
        return None
    return _Surfaces(means, normals, areas / areas.sum(), flat / flat.sum())


def _plane_normals(surfaces: _Surfaces) -> list[Float64[ndarray, "3"]]:
    """The directions that most of the flat area faces, one way or the other, `_APART` from each other."""
    normals, weights = surfaces.normals, surfaces.flat_areas
    few = slice(None, None, 1 + len(normals) // 4000)
    directions = _half_sphere(400)
    facing = (np.abs(directions @ normals[few].T) > _ALIGNED) @ weights[few]
    chosen: list[Float64[ndarray, "3"]] = []
    for index in np.argsort(-facing):
        if all(abs(directions[index] @ other) < _APART for other in chosen):
            chosen.append(_refined(surfaces, directions[index]))
        if len(chosen) == 6:
            break
    return chosen


def _refined(surfaces: _Surfaces, direction: Float64[ndarray, "3"], rounds: int = 6) -> Float64[ndarray, "3"]:
    """The mean normal of what faces that way: mean shift, narrower each time."""
    for angle in np.linspace(15, 6, rounds):
        cosines = surfaces.normals @ direction
        weights = surfaces.flat_areas * np.sign(cosines) * (np.abs(cosines) > np.cos(np.radians(angle)))
        mean = weights @ surfaces.normals
        if np.linalg.norm(mean) < 1e-12:
            break
        direction = mean / np.linalg.norm(mean)
    return direction


def _ground_of(surfaces: _Surfaces, normal: Float64[ndarray, "3"]) -> tuple[float, Float64[ndarray, "3"]]:
    """How much a plane near this normal looks like the ground (0 … 1), and its unit normal away from it.

    It is the share of the densest layer, less as there is as much below it as above.
    """
    for _ in range(4):
        layer, lying, densest = _densest_layer(surfaces, normal)
        normal = _fitted_normal(surfaces, lying * (np.abs(layer - densest) <= 1), normal)
    layer, lying, densest = _densest_layer(surfaces, normal)
    share = float(lying[np.abs(layer - densest) <= 1].sum())
    below = float(surfaces.areas[layer < densest - 1].sum())
    above = float(surfaces.areas[layer > densest + 1].sum())
    one_sided = abs(above - below) / max(above + below, 1e-30)
    return share * one_sided, normal if above >= below else -normal


def _densest_layer(
    surfaces: _Surfaces, normal: Float64[ndarray, "3"]
) -> tuple[Int64[ndarray, " n"], Float64[ndarray, " n"], int]:
    """The layer of each splat across `normal`, the flat area of those that lie in them, and which has most with the
    two beside it."""
    heights = surfaces.means @ normal
    low, high = heights.min(), heights.max()
    layer = np.minimum(((heights - low) / max(high - low, 1e-30) * _LAYERS).astype(np.int64), _LAYERS - 1)
    lying = surfaces.flat_areas * (np.abs(surfaces.normals @ normal) > _ALIGNED)
    padded = np.pad(np.bincount(layer, lying, _LAYERS), 1)
    return layer, lying, int((padded[:-2] + padded[1:-1] + padded[2:]).argmax())


def _fitted_normal(
    surfaces: _Surfaces, weights: Float64[ndarray, " n"], normal: Float64[ndarray, "3"]
) -> Float64[ndarray, "3"]:
    """Of the plane through splats; they are centred, so a layer that is cut out askew straightens as it is fitted."""
    if not weights.sum() > 0:
        return normal
    offsets = surfaces.means - np.average(surfaces.means, axis=0, weights=weights)
    fitted = np.linalg.eigh((offsets * weights[:, None]).T @ offsets)[1][:, 0]
    return fitted if fitted @ normal >= 0 else -fitted


def _half_sphere(count: int) -> Float64[ndarray, "{count} 3"]:
    """Directions spread evenly over half a sphere (a Fibonacci lattice), and the axes."""
    steps = np.arange(count - 3) + 0.5
    height, angle = steps / (count - 3), np.pi * (1 + np.sqrt(5)) * steps
    radius = np.sqrt(1 - height**2)
    lattice = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    return np.concatenate([np.eye(3), lattice])


def _snapped(direction: Float[ndarray, "3"]) -> Float64[ndarray, "3"]:
    axis, angle = nearest_axis(direction)
    return direction_of(axis) if angle < SNAP else np.asarray(direction, np.float64)
