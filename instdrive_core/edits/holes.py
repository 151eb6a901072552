"""Ground that nothing ever showed, because what is deleted now stood before it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.document import Document
from instdrive_core.edits.ground_grid import GroundGrid, rasterized
from instdrive_core.edits.ground_plane import ground_plane
from instdrive_core.edits.placement import SOLID_OPACITY
from instdrive_core.edits.sight import Occluder, sightings, standing
from instdrive_core.edits.surroundings import Neighborhood, Standing, Surroundings, standing_around

CELL = 0.2
"""Metres per side of a cell."""
HALF_LENGTH, HALF_WIDTH = 12.0, 7.0
"""Metres along and across the lane that the map reaches from the middle."""
PLANE_RADIUS = 8.0
"""Metres around the middle that the ground plane is fitted to."""
PLANE_BAND = 2.5
"""Metres below the middle of what stood there, and above, that ground is looked for."""
GROUND_BAND = (-0.12, 0.3)
"""Metres above the plane between which ground lies: kerbs and pavements included."""
STANDING_BAND = (0.4, 2.5)
"""Metres above the plane at which something stands on the ground."""
MIN_COVER = 0.6
"""Share of light that solid ground stops."""
MIN_SIGHTINGS = 2
"""Photos that must show a place for its colour to be known."""
MAX_AWAY = 3.0
"""Metres from what was deleted that its hole reaches."""
PALETTE_RING = 2.0
"""Metres around a cell within which ground of its colour must lie …"""
MAX_COLOR_DIFFERENCE = 0.12
"""… up to this difference of R, G or B."""
MIN_AREA = 0.15
"""Square metres: smaller holes are gaps between splats."""
FOOTPRINT_MARGIN = 0.15
"""Metres around the footprint of what was deleted, where no photos say what is hidden."""


@dataclass(frozen=True)
class GroundMap:
    """The ground around a place, cell by cell."""

    grid: GroundGrid
    cover: Float64[ndarray, "a b"]
    """Share of light that ground splats stop."""
    color: Float64[ndarray, "a b 3"]
    height: Float64[ndarray, "a b"]
    """Metres above the grid's plane."""
    obstructed: Bool[ndarray, "a b"]
    """Something stands there."""
    ground: Bool[ndarray, " k"]
    """Which splats of the neighbourhood the ground is made of."""


@dataclass(frozen=True)
class Hole:
    """Ground cells to be filled."""

    grid: GroundGrid
    cells: Int64[ndarray, "h 2"]
    hidden: Bool[ndarray, "a b"]
    """Cells that too few photos show: no ground to copy from."""

    @property
    def area(self) -> float:
        """Square metres."""
        return len(self.cells) * self.grid.size**2

    @property
    def outlines(self) -> Float64[ndarray, "h 4 3"]:
        """Corners of each cell on the ground, metres."""
        return self.grid.corners(self.cells)


def hole_under(found: Surroundings, residue: Int64[ndarray, " r"]) -> Hole | None:
    """The ground that a deletion uncovers and no photo showed; None where there is no ground around.

    `residue` are rows that are left of what was deleted: they neither cover the ground nor stand on it.
    """
    grid = grid_around(found)
    if grid is None:
        return None
    around = without_rows(found.around, residue)
    ground = ground_map(grid, around)
    footprint, reached = _footprints(grid, found.deleted)
    hidden, uncovered = _hidden_cells(grid, found)
    if hidden is None:
        grown = ndimage.binary_dilation(footprint, iterations=round(FOOTPRINT_MARGIN / CELL))
        hidden = uncovered = np.asarray(grown, bool)
    candidates = hidden & (uncovered | footprint) & reached & (footprint | ~ground.obstructed)
    wrong = candidates & ~_plausible(ground, hidden)
    missing = footprint & ~_solid(ground)
    cells = np.argwhere(_large_parts(_closed(wrong, candidates) | missing))
    return Hole(grid, cells, hidden)


def _closed(wrong: Bool[ndarray, "a b"], candidates: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    """With the cells at their edge, which seemed solid for the ground beside them, and those amid them that happen to
    look right."""
    grown = np.pad(np.asarray(ndimage.binary_dilation(wrong)), 3)
    closed = np.asarray(ndimage.binary_closing(grown, np.ones((3, 3)), iterations=2))[3:-3, 3:-3]
    return wrong | (closed & candidates)


def grid_around(found: Surroundings) -> GroundGrid | None:
    """Cells along the lane, on the plane of the ground; None where there are too few splats for one."""
    near = found.around
    offsets = near.means - found.place.astype(np.float32)
    close = (np.hypot(offsets[:, 0], offsets[:, 1]) <= PLANE_RADIUS) & (np.abs(offsets[:, 2]) <= PLANE_BAND)
    plane = ground_plane(offsets[close & (near.opacities >= SOLID_OPACITY) & ~near.compact])
    if plane is None:
        return None
    shape = (round(2 * HALF_LENGTH / CELL), round(2 * HALF_WIDTH / CELL))
    level = float(found.place[2] + plane[0] - plane[1:] @ found.place[:2])
    grid = GroundGrid((0.0, 0.0), found.along, CELL, shape, (level, float(plane[1]), float(plane[2])))
    x, y = (found.place[:2] - np.array([HALF_LENGTH, HALF_WIDTH]) @ grid.axes).tolist()
    return replace(grid, corner=(x, y))


def ground_map(grid: GroundGrid, near: Neighborhood) -> GroundMap:
    """Which splats are ground, and what it looks like from above."""
    heights = grid.heights(near.means)
    flat = (heights >= GROUND_BAND[0]) & (heights <= GROUND_BAND[1])
    ground = flat & ~near.compact & (near.scales.max(axis=1) <= 5 * grid.size)
    rows = np.flatnonzero(ground)
    values = np.c_[near.colors[rows], heights[rows]]
    raster = rasterized(grid, near.means[rows], near.quats[rows], near.scales[rows], near.opacities[rows], values)
    solid = near.opacities >= SOLID_OPACITY
    upright = solid & (heights >= STANDING_BAND[0]) & (heights <= STANDING_BAND[1])
    counts = grid.counted(grid.cells_of(near.means[upright]))
    crowded = np.asarray(ndimage.uniform_filter(counts.astype(np.float64), 3, mode="constant")) * 9 >= 2
    return GroundMap(grid, raster.cover, raster.values[..., :3], raster.values[..., 3], crowded & (counts > 0), ground)


def without_rows(near: Neighborhood, rows: Int64[ndarray, " r"]) -> Neighborhood:
    """The neighbourhood without some rows of the document."""
    kept = ~np.isin(near.rows, rows)
    return Neighborhood(**{name: getattr(near, name)[kept] for name in near.__dataclass_fields__})


def known_ground(document: Document, grid: GroundGrid, near: Neighborhood) -> tuple[GroundMap, Bool[ndarray, "a b"]]:
    """The ground as it is now, and where it is known: solid, free, and shown by enough photos."""
    ground = ground_map(grid, near)
    others = standing_around(document, near)
    occluders = [each for each in (_occluder(one, grid) for one in others) if each is not None]
    points = grid.on_ground(grid.centers(grid.all_cells()))
    seen, _ = sightings(points, document.scene.views, occluders, 0)
    known = _solid(ground) & ~ground.obstructed
    under = np.zeros(grid.shape, bool)
    for each in others:
        under |= _under(each, points[:, :2]).reshape(grid.shape)
    if (seen >= MIN_SIGHTINGS).any():
        known &= (seen >= MIN_SIGHTINGS).reshape(grid.shape)
    return ground, known & ~under


def _solid(ground: GroundMap) -> Bool[ndarray, "a b"]:
    """Cells with solid ground in them or close around: it may lie in lines, as a LiDAR saw it."""
    return np.asarray(ndimage.uniform_filter(ground.cover, 3, mode="nearest")) >= MIN_COVER / 2


def _hidden_cells(grid: GroundGrid, found: Surroundings) -> tuple[Bool[ndarray, "a b"] | None, Bool[ndarray, "a b"]]:
    """Cells that fewer than `MIN_SIGHTINGS` photos show, and those that the deleted objects hid from any; None where
    there are no photos around to tell."""
    points = grid.on_ground(grid.centers(grid.all_cells()))
    occluders = [_occluder(each, grid) for each in (*found.deleted, *found.others)]
    chosen = sum(each is not None for each in occluders[: len(found.deleted)])
    seen, hidden = sightings(points, found.views, [each for each in occluders if each is not None], chosen)
    away = np.linalg.norm(points[:, :2] - found.place[:2], axis=1)
    if not (seen[away < MAX_AWAY + 2] > 0).any():
        return None, np.zeros(grid.shape, bool)
    return (seen < MIN_SIGHTINGS).reshape(grid.shape), (hidden > 0).reshape(grid.shape)


def _occluder(each: Standing, grid: GroundGrid) -> Occluder | None:
    if each.track is None:
        floor = float(grid.on_ground(each.body.center[None, :2])[0, 2])
    else:
        floor = -float(each.track.dimensions[2]) / 2
    return standing(each.body, each.points, floor, each.track)


def _footprints(grid: GroundGrid, deleted: tuple[Standing, ...]) -> tuple[Bool[ndarray, "a b"], Bool[ndarray, "a b"]]:
    """Cells under the hulls of what stood there, and those within `MAX_AWAY` of them. Where an actor drove is none of
    its footprint: photos before and after show it."""
    under, places = np.zeros(grid.shape, bool), grid.centers(grid.all_cells())
    reached: Bool[ndarray, "a b"] = np.zeros(grid.shape, bool)
    for each in deleted:
        if each.track is None:
            under |= _under(each, places).reshape(grid.shape)
        else:
            times = each.track.times
            path = np.stack([each.track.pose_at(time)[:2, 3] for time in times[:: max(1, len(times) // 20)]])
            gaps = np.linalg.norm(places[:, None] - path[None], axis=-1).min(axis=1)
            reached |= (gaps <= MAX_AWAY).reshape(grid.shape)
    if under.any():
        reached |= _distances(~under) * grid.size <= MAX_AWAY
    return under, reached


def _distances(free: Bool[ndarray, "a b"]) -> Float64[ndarray, "a b"]:
    """Cells from each free one to the nearest that is not."""
    return np.asarray(ndimage.distance_transform_edt(free), np.float64)


def _under(each: Standing, places: Float64[ndarray, "c 2"]) -> Bool[ndarray, " c"]:
    """Whether any point above each place is in the body's hull: its faces clip the vertical line from both ends."""
    body = each.body
    level = (np.c_[places, np.full(len(places), body.center[2])] - body.center) @ body.axes
    starts = level @ body.planes[:, :3].T + body.planes[:, 3]
    slopes = np.broadcast_to(body.planes[:, 2], starts.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = -starts / slopes
    upper = np.where(slopes > 1e-9, ends, np.inf).min(axis=1)
    lower = np.where(slopes < -1e-9, ends, -np.inf).max(axis=1)
    beside = ((np.abs(slopes) <= 1e-9) & (starts > 0)).any(axis=1)
    return (lower < upper) & ~beside


def _plausible(ground: GroundMap, hidden: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    """Cells whose ground is solid and of a colour and height that known ground around has, too."""
    solid = _solid(ground)
    known = ~hidden & solid & ~ground.obstructed
    reach = round(PALETTE_RING / ground.grid.size)
    low, high = _range_around(ground.color, known, reach)
    near = (ground.color >= low - MAX_COLOR_DIFFERENCE) & (ground.color <= high + MAX_COLOR_DIFFERENCE)
    return near.all(axis=2) & solid


def _range_around(
    values: Float64[ndarray, "a b 3"], known: Bool[ndarray, "a b"], reach: int
) -> tuple[Float64[ndarray, "a b 3"], Float64[ndarray, "a b 3"]]:
    """Lowest and highest value of known cells in a square around each cell."""
    size = (2 * reach + 1, 2 * reach + 1, 1)
    low = ndimage.minimum_filter(np.where(known[..., None], values, np.inf), size, mode="nearest")
    high = ndimage.maximum_filter(np.where(known[..., None], values, -np.inf), size, mode="nearest")
    return np.asarray(low), np.asarray(high)


def _large_parts(cells: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    parts = np.zeros(cells.shape, np.int32)
    ndimage.label(cells, np.ones((3, 3)), parts)
    return cells & (np.bincount(parts.ravel())[parts] * CELL**2 >= MIN_AREA)
