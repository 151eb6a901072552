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
from instdrive_core.scene.upright import UP, Axis, compute_axis_direction, find_nearest_axis, format_axis
from instdrive_core.wording import phrase

LOOKED_AT = 20_000
"""Splats that decide, evenly chosen."""
SNAP = 3.0
"""Degrees from an axis below which the axis is meant."""
_AGREED, _ALIKE = 0.2, 0.7
"""Length of the mean of the cameras' ups above which they agree which side is up, and above which it is up itself."""
_FAINT = 0.1
"""Opacity below which splats make no ground."""
_ALIGNED = np.cos(np.radians(25.0))
"""How well a splat's normal must agree with a plane's to lie in it."""
_APART = np.cos(np.radians(35.0))
"""Planes that are closer than this are one plane, seen twice."""
_FARTHEST = 20.0
"""Median distances from the middle beyond which nothing counts, however many strays there are."""
_LAYER = 0.02
"""Height of a layer, as a share of the median distance from the middle."""
_BESIDE = 2
"""Layers on either side of the densest one that are the ground, too: streets are not flat."""
_SURE, _SURER_THAN_OTHERS = 0.11, 2.0
"""How much the ground must look like one, and how many times as much as anything else does. Streets have 0.14 to 0.24,
a thing on a table 0.12, a guitar's front 0.10."""
_OPAQUE = 0.5
"""Opacity above which a splat belongs to a thing: what hangs below a street, unseen by photos, is fainter."""
_STANDING = 1.0
"""Height over the ground, in median distances from the middle, within which things say which side they stand on."""
_CUSTOM: Axis = "-y"
"""Up in files of most other programs, whose axes are those of a photo's camera: right, down, forward."""


@dataclass(frozen=True)
class UpEstimate:
    """A guess, and how it was made."""

    direction: Float64[ndarray, "3"]
    """Unit vector in the scene's axes; exactly an axis where it is within `SNAP` of one."""
    confident: bool
    """Whether it is sure enough to be told without being asked."""
    reason: str
    """How it is known, e.g. ``the photos' cameras``."""

    @property
    def axis(self) -> Axis:
        """The nearest axis."""
        return find_nearest_axis(self.direction)[0]

    @property
    def tilt(self) -> float:
        """Degrees from that axis; 0 where it is meant exactly."""
        return find_nearest_axis(self.direction)[1]

    @property
    def words(self) -> str:
        """``−Y``, or ``12° from −Y``."""
        axis = format_axis(self.axis)
        return phrase("{tilt:.0f}° from {axis}", tilt=self.tilt, axis=axis) if self.tilt else axis


@dataclass(frozen=True)
class _Surfaces:
    """Splats as pieces of surfaces, weighted by what they cover, the more the flatter they are."""

    means: Float64[ndarray, "n 3"]
    """From the middle of the scene, in units of the median distance from it."""
    normals: Float64[ndarray, "n 3"]
    areas: Float64[ndarray, " n"]
    """Relative; they sum to 1."""
    flat_areas: Float64[ndarray, " n"]
    """Areas times flatness, of the same total."""
    solid_areas: Float64[ndarray, " n"]
    """Areas of what is opaque and no larger than most, 0 elsewhere: things, but no haze."""


@dataclass(frozen=True)
class _Ground:
    """A plane that may be the ground."""

    score: float
    """How much it looks like one, 0 … 1."""
    up: Float64[ndarray, "3"]
    """Unit normal on the side where things stand."""


def estimate_up(scene: Scene, stated: Axis | None = None) -> UpEstimate:
    """Estimate which way is up in a scene; `stated` is what its file's format says, in this program's axes.

    Cameras are believed first, then a clear ground, then the format. What has instances was made by this program, and
    has z up; else the most common axis is given, without confidence.
    """
    cameras = _estimate_up_from_cameras(scene.views)
    if cameras is not None:
        return UpEstimate(_snap_direction(cameras), True, phrase("the photos' cameras"))
    ground = _find_ground(scene.gaussians, np.flatnonzero(scene.nodes == 0))
    if ground is not None:
        return UpEstimate(_snap_direction(ground.up), True, phrase("the ground"))
    if stated is not None:
        return UpEstimate(compute_axis_direction(stated), True, phrase("the file's format"))
    return UpEstimate(compute_axis_direction(UP if len(scene.table) else _CUSTOM), False, "custom")


def estimate_up_from_splats(gaussians: Gaussians, rows: Int64[ndarray, " k"]) -> Float64[ndarray, "3"] | None:
    """Estimate the upward unit normal of the ground that these rows make; None where no plane is clearly the ground."""
    ground = _find_ground(gaussians, rows)
    return None if ground is None else ground.up


def _find_ground(gaussians: Gaussians, rows: Int64[ndarray, " k"]) -> _Ground | None:
    """Find the plane that is clearly the ground; None where none is."""
    surfaces = _collect_surfaces(gaussians.select(rows[:: 1 + len(rows) // LOOKED_AT]))
    if surfaces is None:
        return None
    found = sorted(
        (_rate_ground(surfaces, normal) for normal in _find_plane_normals(surfaces)), key=lambda each: -each.score
    )
    best, others = found[0], found[1:]
    apart = [other.score for other in others if abs(other.up @ best.up) < _APART]
    return best if best.score >= _SURE and best.score >= _SURER_THAN_OTHERS * max(apart, default=0.0) else None


def _estimate_up_from_cameras(views: Sequence[CameraView]) -> Float64[ndarray, "3"] | None:
    """Level across all pictures: what no camera's x axis points along, on the side of their tops.

    Cameras that look down all the same, e.g. from a drone that went in circles, have tops that lean in every direction.
    """
    if not views:
        return None
    poses = np.stack([view.camera.world_from_camera for view in views])
    mean = -poses[:, :3, 1].mean(axis=0)
    sizes, axes = np.linalg.eigh(poses[:, :3, 0].T @ poses[:, :3, 0] / len(views))
    if sizes[1] - sizes[0] > 0.1:  # they look in more than one direction
        level = axes[:, 0] * np.sign(axes[:, 0] @ mean)
        return level if level @ mean > _AGREED else None
    return mean / np.linalg.norm(mean) if np.linalg.norm(mean) > _ALIKE else None


def _collect_surfaces(part: Gaussians) -> _Surfaces | None:
    """Collect the splats that count: finite, not faint, not among the farthest 3 %. None for fewer than 200.

    Nothing here depends on the axes, so that a scene is judged the same however it lies.
    """
    finite = [np.isfinite(array).all(axis=1) for array in (part.means, part.quats, part.log_scales)]
    part = part.select(np.logical_and.reduce([*finite, part.opacities > _FAINT]))
    if len(part) < 200:
        return None
    means = part.means.astype(np.float64)
    means -= _compute_middle(means)
    distances = np.linalg.norm(means, axis=1)
    size = float(np.median(distances))
    if not size > 0:
        return None
    near = distances <= min(np.quantile(distances, 0.97), _FARTHEST * size)
    part, means = part.select(near), means[near] / size
    scales, rotations = part.scales.astype(np.float64), matrix_from_quaternion(part.quats.astype(np.float64))
    normals = np.take_along_axis(rotations, scales.argmin(axis=1)[:, None, None], axis=2)[:, :, 0]
    thin, middle, wide = np.sort(scales, axis=1).T
    areas = middle * wide * part.opacities
    areas = np.minimum(areas, np.quantile(areas, 0.98))  # a few giants, often of sky, are no ground
    flat = areas * (1 - thin / np.maximum(middle, 1e-30)) ** 2
    if not flat.sum() > 0:
        return None
    solid = areas * (part.opacities > _OPAQUE) * (areas <= np.quantile(areas, 0.9))
    return _Surfaces(means, normals, areas / areas.sum(), flat / flat.sum(), solid / areas.sum())


def _compute_middle(means: Float64[ndarray, "n 3"]) -> Float64[ndarray, "3"]:
    """The geometric median (Weiszfeld's iteration): strays do not count, and neither do the axes."""
    middle = np.median(means, axis=0)
    for _ in range(10):
        weights = 1 / np.maximum(np.linalg.norm(means - middle, axis=1), 1e-12)
        middle = weights @ means / weights.sum()
    return middle


def _find_plane_normals(surfaces: _Surfaces) -> list[Float64[ndarray, "3"]]:
    """The directions that most of the flat area faces, one way or the other, `_APART` from each other."""
    normals, weights = surfaces.normals, surfaces.flat_areas
    few = slice(None, None, 1 + len(normals) // 4000)
    directions = _build_half_sphere(400)
    facing = (np.abs(directions @ normals[few].T) > _ALIGNED) @ weights[few]
    chosen: list[Float64[ndarray, "3"]] = []
    for index in np.argsort(-facing):
        if all(abs(directions[index] @ other) < _APART for other in chosen):
            chosen.append(_refine_normal(surfaces, directions[index]))
        if len(chosen) == 6:
            break
    return chosen


def _refine_normal(surfaces: _Surfaces, direction: Float64[ndarray, "3"], rounds: int = 6) -> Float64[ndarray, "3"]:
    """The mean normal of what faces that way: mean shift, in a cone that is narrower each time."""
    for angle in np.linspace(30, 8, rounds):  # wider at first than what chose the direction: the plane may be off it
        cosines = surfaces.normals @ direction
        weights = surfaces.flat_areas * np.sign(cosines) * (np.abs(cosines) > np.cos(np.radians(angle)))
        mean = weights @ surfaces.normals
        if np.linalg.norm(mean) < 1e-12:
            break
        direction = mean / np.linalg.norm(mean)
    return direction


def _rate_ground(surfaces: _Surfaces, normal: Float64[ndarray, "3"]) -> _Ground:
    """Rate how much a plane near this normal looks like the ground, and find the side on which things stand.

    The score is the share of the densest layer, less where there is as much below it as above, or where it is narrow.
    """
    for _ in range(4):
        layer, lying, densest = _find_densest_layer(surfaces, normal)
        normal = _fit_normal(surfaces, lying * (np.abs(layer - densest) <= _BESIDE), normal)
    layer, lying, densest = _find_densest_layer(surfaces, normal)
    ground = lying * (np.abs(layer - densest) <= _BESIDE)
    side = _compare_sides(surfaces.areas, layer - densest)
    near = np.abs(layer - densest) <= _STANDING / _LAYER
    solid = _compare_sides(surfaces.solid_areas * near, layer - densest)
    score = float(ground.sum()) * abs(side) * min(1.0, _measure_breadth(surfaces, ground, normal))
    return _Ground(score, normal if (solid or side) >= 0 else -normal)


def _compare_sides(areas: Float64[ndarray, " n"], layers: Int64[ndarray, " n"]) -> float:
    """The difference of what is above and below layer 0, as a share of both: 1 where all is above, -1 where below."""
    below, above = float(areas[layers < -_BESIDE].sum()), float(areas[layers > _BESIDE].sum())
    return (above - below) / max(above + below, 1e-30)


def _measure_breadth(surfaces: _Surfaces, ground: Float64[ndarray, " n"], normal: Float64[ndarray, "3"]) -> float:
    """How far the ground reaches the way it is narrowest, in units of how far the scene reaches up: a facade is as low
    as the scene, and less broad than it is deep."""
    sizes, _ = _compute_spread(surfaces, ground)
    heights = surfaces.means @ normal
    middle = surfaces.areas @ heights
    return float(np.sqrt(max(sizes[1], 0.0) / max(surfaces.areas @ (heights - middle) ** 2, 1e-30)))


def _compute_spread(
    surfaces: _Surfaces, weights: Float64[ndarray, " n"]
) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3 3"]]:
    """Variances of weighted splats along their principal axes, rising, and the axes as columns."""
    total = max(float(weights.sum()), 1e-30)
    offsets = surfaces.means - weights @ surfaces.means / total
    return np.linalg.eigh((offsets * weights[:, None]).T @ offsets / total)


def _find_densest_layer(
    surfaces: _Surfaces, normal: Float64[ndarray, "3"]
) -> tuple[Int64[ndarray, " n"], Float64[ndarray, " n"], int]:
    """The layer of each splat across `normal`, the flat area of those that lie in them, and which has most with those
    beside it."""
    heights = surfaces.means @ normal
    layer = ((heights - heights.min()) / _LAYER).astype(np.int64)
    lying = surfaces.flat_areas * (np.abs(surfaces.normals @ normal) > _ALIGNED)
    thick = np.convolve(np.bincount(layer, lying), np.ones(2 * _BESIDE + 1), "same")
    return layer, lying, int(thick.argmax())


def _fit_normal(
    surfaces: _Surfaces, weights: Float64[ndarray, " n"], normal: Float64[ndarray, "3"]
) -> Float64[ndarray, "3"]:
    """Fit the normal of the plane through splats: a layer that is cut out askew straightens as it is fitted."""
    if not weights.sum() > 0:
        return normal
    fitted = _compute_spread(surfaces, weights)[1][:, 0]
    return fitted if fitted @ normal >= 0 else -fitted


def _build_half_sphere(count: int) -> Float64[ndarray, "{count} 3"]:
    """Directions spread evenly over half a sphere (a Fibonacci lattice), and the axes."""
    steps = np.arange(count - 3) + 0.5
    height, angle = steps / (count - 3), np.pi * (1 + np.sqrt(5)) * steps
    radius = np.sqrt(1 - height**2)
    lattice = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    return np.concatenate([np.eye(3), lattice])


def _snap_direction(direction: Float[ndarray, "3"]) -> Float64[ndarray, "3"]:
    axis, angle = find_nearest_axis(direction)
    return compute_axis_direction(axis) if angle < SNAP else np.asarray(direction, np.float64)
