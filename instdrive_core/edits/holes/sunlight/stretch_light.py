"""The light on the street around a place of a document, as its photos recorded it, whatever was edited since."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.document.array_digest import digest_array
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC
from instdrive_core.edits.holes.free_space import build_occluder, count_sightings
from instdrive_core.edits.holes.ground_cells import find_covered_cells, grow_cells
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_light import GroundLight
from instdrive_core.edits.holes.ground_map import (
    MAX_SPLAT,
    GroundMap,
    build_ground_map,
    find_solid_cells,
)
from instdrive_core.edits.holes.ground_plane import fit_ground_plane
from instdrive_core.edits.holes.holes import EDGE, MIN_SIGHTINGS, PLANE_RADIUS
from instdrive_core.edits.holes.lanes.carriageway import measure_rise
from instdrive_core.edits.holes.lanes.road_direction import find_road_direction
from instdrive_core.edits.holes.sunlight.standing_rows import LOWEST, find_standing_rows
from instdrive_core.edits.holes.sunlight.street_light import StreetLight, find_street_light
from instdrive_core.edits.holes.surroundings import Neighborhood, StandingObject, copy_neighborhood
from instdrive_core.edits.queries.compact_objects import is_tall
from instdrive_core.edits.queries.placement import SOLID_OPACITY, find_lane
from instdrive_core.errors import EditError
from instdrive_core.instances.interiors import DEFAULT_CONFIG, fit_compact_object
from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import compute_current_means, find_away

CELL = 0.2
"""Metres per side of a cell."""
EVERY = 2
"""Every so-many-th cell of the ground along and across is looked at."""
HALF_LENGTH, HALF_WIDTH = 32.0, 13.0
"""Metres along and across the lane that are looked at around a station of the drive."""
STATIONS = 10.0
"""Metres between the places of the drive around which the light is looked at."""
CAMERA_BAND = 4.0
"""Metres below the cameras between which the road is looked for."""
BROAD_SPLAT = 0.1
"""Metres: of splats with a larger standard deviation more than the middle throws a shadow."""
MOST_FRAMES = 60
"""Photos that are asked how high they would show a house."""
MOST_KEPT = 8
"""Stretches whose light is kept in memory."""

_kept: dict[tuple[object, ...], _Stretch | None] = {}


@dataclass(frozen=True)
class _Stretch:
    light: StreetLight
    rows: Int64[ndarray, " n"]
    """Rows of the document that the points which throw shadows are of."""


def find_hole_light(
    document: Document,
    ground: GroundMap,
    known: Bool[ndarray, "a b"],
    hole: Bool[ndarray, "a b"],
    lowest: Bool[ndarray, " b"] | None,
    gone: Int64[ndarray, " g"],
) -> GroundLight | None:
    """The light on a map of the ground around a `hole`; None where there is no sun, or nothing tells where it stands.

    `known` and `lowest` are those of `plan_fill`. The rows `gone` throw no shadow any more, nor do deleted ones.
    """
    cells = np.argwhere(hole)
    place = ground.grid.compute_centers(cells).mean(axis=0)
    stretch = _find_stretch(document, place)
    if stretch is None:
        return None
    own = stretch.light.rows.grid
    if not own.contains(own.find_cells(ground.grid.compute_centers(cells))).all():
        return None
    flags = document.state.flags[stretch.rows]
    standing = ((flags & Flag.DELETED) == 0) & ~np.isin(stretch.rows, gone)
    standing &= ~find_away(document.transforms, stretch.rows)
    rise = measure_rise(ground, known & ~hole, lowest)
    return stretch.light.light_ground(ground.grid, ground.color, hole, rise, standing)


def _find_stretch(document: Document, place: Float64[ndarray, "2"]) -> _Stretch | None:
    scene = document.scene
    stations = _list_stations(scene.views)
    if not len(stations):
        return None
    station = stations[int(np.linalg.norm(stations[:, :2] - place, axis=1).argmin())]
    away = find_away(document.transforms, np.arange(len(scene)))
    made = scene.extra.get(SYNTHETIC, np.zeros(len(scene), np.uint8))
    colors = scene.gaussians.sh_dc
    parts = (scene.gaussians.means, colors, scene.instance_ids, away, made, document.transforms.homes)
    key = (*(digest_array(each) for each in parts), tuple(station.tolist()), len(scene.views))
    if key not in _kept:
        while len(_kept) >= MOST_KEPT:
            _kept.pop(next(iter(_kept)))
        _kept[key] = _look_along(document, station, np.flatnonzero((scene.nodes == 0) & ~away & (made == 0)))
    return _kept[key]


def _list_stations(views: Sequence[CameraView]) -> Float64[ndarray, "s 3"]:
    """Places of the drive that are some metres apart."""
    places: list[ndarray] = []
    for view in sorted(views, key=lambda view: view.time):
        where = np.asarray(view.camera.position, np.float64)
        if all(np.linalg.norm((where - each)[:2]) >= STATIONS for each in places):
            places.append(where)
    return np.array(places).reshape(-1, 3)


def _look_along(document: Document, station: Float64[ndarray, "3"], rows: Int64[ndarray, " m"]) -> _Stretch | None:
    """The light around a station of the drive, as the splats of `rows` show it."""
    scene = document.scene
    means = compute_current_means(scene.gaussians, document.transforms)[rows]
    try:
        lane = find_lane(document, (), station, 0.0)
    except EditError:
        return None
    local = (means[:, :2] - station[:2]) @ np.array([[lane[0], -lane[1]], [lane[1], lane[0]]])
    inside = (np.abs(local) <= (HALF_LENGTH, HALF_WIDTH)).all(axis=1)
    rows, means, local = rows[inside], means[inside], local[inside]
    near = copy_neighborhood(document, rows)
    below = station[2] - near.means[:, 2]
    around = (np.hypot(*local.T) <= PLANE_RADIUS) & (below >= 0) & (below <= CAMERA_BAND)
    around &= (near.opacities >= SOLID_OPACITY) & ~near.compact
    plane = fit_ground_plane(near.means[around].astype(np.float64) - [*station[:2], 0])
    if plane is None:
        return None
    level = float(plane[0] - plane[1:] @ station[:2])
    shape = (round(2 * HALF_LENGTH / CELL), round(2 * HALF_WIDTH / CELL))
    grid = GroundGrid(
        (0.0, 0.0), (float(lane[0]), float(lane[1])), CELL, shape, (level, float(plane[1]), float(plane[2]))
    )
    grid = replace(grid, along=find_road_direction(grid, near))
    x, y = (station[:2] - np.array([HALF_LENGTH, HALF_WIDTH]) @ grid.axes).tolist()
    grid = replace(grid, corner=(x, y))
    views = [view for view in scene.views if np.linalg.norm(view.camera.position - station) <= 2 * HALF_LENGTH]
    rise = _follow_road(grid, views)
    flat = near.means.copy()
    flat[:, 2] -= rise(near.means)
    near = replace(near, means=flat)
    level_views = [_lower(view, rise) for view in views]
    return _measure_light(document, grid, near, rows, level_views)


def _follow_road(grid: GroundGrid, views: Sequence[CameraView]) -> Callable[[ndarray], ndarray]:
    """How many metres higher than the grid's plane the road is along the drive: as the cameras rise."""
    eyes = np.array([view.camera.position for view in views])
    along = (eyes[:, :2] - np.array(grid.corner)) @ grid.axes[0]
    heights = grid.compute_heights(eyes)
    order = np.argsort(along, kind="stable")
    bins = np.unique(np.round(along[order]), return_inverse=True)[1]
    counts = np.bincount(bins)
    places, means = (np.bincount(bins, each[order]) / counts for each in (along, heights))
    middle = float(np.interp(HALF_LENGTH, places, means))

    def rise(points: ndarray) -> ndarray:
        return np.interp((points[:, :2] - np.array(grid.corner)) @ grid.axes[0], places, means) - middle

    return rise


def _lower(view: CameraView, rise: Callable[[ndarray], ndarray]) -> CameraView:
    """The photo with its camera where it would be if the road did not rise."""
    pose = view.camera.world_from_camera.copy()
    pose[2, 3] -= rise(pose[None, :3, 3])[0]
    return replace(view, camera=replace(view.camera, world_from_camera=pose))


def _measure_light(
    document: Document, grid: GroundGrid, near: Neighborhood, rows: Int64[ndarray, " m"], views: Sequence[CameraView]
) -> _Stretch | None:
    things = _list_things(document, near)
    ground = build_ground_map(grid, near)
    under = find_covered_cells(things, grid)
    free = find_solid_cells(ground) & ~ground.obstructed & ~grow_cells(under, grid.size, EDGE)
    some = np.zeros(grid.shape, bool)
    some[::EVERY, ::EVERY] = True
    cells = np.argwhere(free & some)
    points = grid.lift_to_ground(grid.compute_centers(cells))
    hulls = [
        build_occluder(each.body, each.points, float(grid.lift_to_ground(each.body.center[None, :2])[0, 2]))
        for each in things
    ]
    seen, _ = count_sightings(points, views, [each for each in hulls if each is not None], 0)
    cells = cells[seen >= MIN_SIGHTINGS]
    standing, owners = _list_points(grid, near)
    cameras = [view.camera for view in views][:: 1 + len(views) // MOST_FRAMES]
    heights = grid.compute_heights(standing)
    places = (standing[:, :2] - np.array(grid.corner)) @ grid.axes.T
    found = find_standing_rows(grid, places, heights, cameras)
    at = tuple(cells.T)
    known = np.zeros(grid.shape, bool)
    known[at] = True
    light = find_street_light(found, (cells + 0.5) * grid.size, measure_rise(ground, known)[at], ground.color[at])
    return None if light is None else _Stretch(light, rows[owners])


def _list_things(document: Document, near: Neighborhood) -> list[StandingObject]:
    """What stands on the ground and is no taller than vehicles are."""
    things = []
    for number in np.unique(near.instance_ids[near.compact]).tolist():
        if is_tall(document.scene.table[number]):
            continue
        solid = (near.instance_ids == number) & (near.opacities >= DEFAULT_CONFIG.min_opacity)
        points = near.means[solid].astype(np.float64)
        body = fit_compact_object(number, points) if len(points) >= DEFAULT_CONFIG.min_gaussians else None
        if body is not None:
            things.append(StandingObject(body, points, None))
    return things


def _list_points(grid: GroundGrid, near: Neighborhood) -> tuple[Float64[ndarray, "n 3"], Int64[ndarray, " n"]]:
    """Points of what stands, metres, and the splats (rows of `near`) that they are of."""
    solid = (near.opacities >= SOLID_OPACITY) & (near.scales.max(axis=1) <= MAX_SPLAT)
    chosen = np.flatnonzero(solid)
    means = near.means[chosen].astype(np.float64)
    axes = matrix_from_quaternion(normalize_quaternions(near.quats[chosen])) * near.scales[chosen][:, None, :]
    points, owners = [means], [chosen]
    for axis in range(3):
        broad = near.scales[chosen, axis] > BROAD_SPLAT
        for sign in (-1, 1):
            points.append(means[broad] + sign * axes[broad, :, axis])
            owners.append(chosen[broad])
    every, of = np.concatenate(points), np.concatenate(owners)
    stands = grid.compute_heights(every) > LOWEST
    return every[stands], of[stands]
