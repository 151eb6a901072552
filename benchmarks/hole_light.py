"""The light that the fill is told of in `benchmarks.hole_maps`: what photos show of a street, without training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray

from benchmarks.hole_streets import GROUND
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.sensors.render import StepRenderer
from instdrive_core.datasets.synthetic.world.ego import compute_ego_pose
from instdrive_core.datasets.synthetic.world.ground import CURB_HEIGHT
from instdrive_core.datasets.synthetic.world.rig import CAMERAS
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.holes import MIN_SIGHTINGS
from instdrive_core.edits.holes.sunlight.standing_rows import LOWEST, find_standing_rows
from instdrive_core.edits.holes.sunlight.street_light import StreetLight, find_street_light
from instdrive_core.edits.holes.sunlight.stretch_light import CELL, EVERY, HALF_LENGTH, HALF_WIDTH
from instdrive_core.scene.camera import Camera

STRIDE = 3
"""Every so-many-th pixel of a photo along and across is looked at."""
FARTHEST = 60.0
"""Metres."""


@dataclass(frozen=True)
class MapLight:
    """The light on a street, and the instance that each point which throws a shadow is of."""

    light: StreetLight
    owners: Int64[ndarray, " n"]


def find_map_light(street: Street, cameras: Sequence[tuple[float, Camera]], places: KnownPlaces) -> MapLight | None:
    """Find the sun by what these cameras show at their times, of the ground the `places`; None where nothing tells."""
    points, owners = _list_seen_points(street, cameras)
    standing = points[:, 2] > LOWEST
    points, owners = points[standing], owners[standing]
    grid = places.grid
    rows = find_standing_rows(
        grid, (points[:, :2] - np.array(grid.corner)) @ grid.axes.T, points[:, 2], [camera for _, camera in cameras]
    )
    at = (places.cells + 0.5) * grid.size
    light = find_street_light(rows, at, places.heights, places.color.astype(np.float64))
    return None if light is None else MapLight(light, owners)


@dataclass(frozen=True)
class KnownPlaces:
    """Ground that photos show."""

    grid: GroundGrid
    cells: Int64[ndarray, "k 2"]
    heights: Float64[ndarray, " k"]
    color: Float32[ndarray, "k 3"]


def build_street_grid(middle: float) -> GroundGrid:
    """The cells around a place along the street's middle line, metres."""
    shape = (round(2 * HALF_LENGTH / CELL), round(2 * HALF_WIDTH / CELL))
    return GroundGrid((HALF_WIDTH, middle - HALF_LENGTH), (0.0, 1.0), CELL, shape, (0.0, 0.0, 0.0))


def choose_known(
    grid: GroundGrid, color: Float32[ndarray, "a b 3"], classes: ndarray, count: Int64[ndarray, "a b"]
) -> KnownPlaces:
    """Those of the cells of a coarse map of the ground that enough photos show, as places of the street's grid."""
    known = np.isin(classes, GROUND) & (count >= MIN_SIGHTINGS)
    heights = np.where(classes == "Sidewalk", CURB_HEIGHT, 0.0)
    return KnownPlaces(grid, EVERY * np.argwhere(known), heights[known], color[known])


def coarsen(grid: GroundGrid) -> GroundGrid:
    """The cells of which every `EVERY`-th of the street's is one."""
    return replace(grid, size=grid.size * EVERY, shape=(grid.shape[0] // EVERY, grid.shape[1] // EVERY))


def list_cameras(street: Street, times: Sequence[float]) -> list[tuple[float, Camera]]:
    """The rig's cameras at some times (s), and these."""
    size = StreetConfig()
    return [
        (time, rig.place(compute_ego_pose(street, time), size.width, size.height)) for time in times for rig in CAMERAS
    ]


def _list_seen_points(
    street: Street, cameras: Sequence[tuple[float, Camera]]
) -> tuple[Float64[ndarray, "n 3"], Int64[ndarray, " n"]]:
    """Points of what stands that photos show, metres, and the instances they are of."""
    still = _find_still(street)
    points, owners = [], []
    renderer, shown = None, None
    for time, camera in cameras:
        if renderer is None or time != shown:
            renderer, shown = StepRenderer(street.geometry(time), street.materials, street.light), time
        rays = _cast(camera)
        starts = np.broadcast_to(camera.position.astype(np.float32), rays.shape).copy()
        hits = renderer.rays.find_first_hits(starts, rays)
        ids = renderer.geometry.instances[np.maximum(hits.triangles, 0)]
        kept = (hits.triangles >= 0) & (hits.distances < FARTHEST) & still[ids]
        points.append((starts + rays * hits.distances[:, None])[kept].astype(np.float64))
        owners.append(ids[kept].astype(np.int64))
    return np.concatenate(points), np.concatenate(owners)


def _find_still(street: Street) -> Bool[ndarray, " ids"]:
    """By instance ID: things that stand still, and are no ground."""
    labels = np.array(["", *(each.label for each in street.fixtures), *(each.label for each in street.actors)])
    moves = np.array([True, *(False for _ in street.fixtures), *(each.route.moves for each in street.actors)])
    return ~moves & ~np.isin(labels, GROUND)


def _cast(camera: Camera) -> Float32[ndarray, "r 3"]:
    """Unit directions in the world of some of the pixels."""
    columns, lines = np.meshgrid(*(np.arange(0, size, STRIDE) + 0.5 for size in (camera.width, camera.height)))
    local = np.stack([(columns - camera.cx) / camera.fx, (lines - camera.cy) / camera.fy, np.ones_like(lines)], axis=-1)
    rays = local.reshape(-1, 3) @ camera.world_from_camera[:3, :3].T
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
