"""Ground that nothing ever showed, because what is deleted now stood before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

from instdrive_core.edits.document import Document
from instdrive_core.edits.ground_grid import GroundGrid, GroundRaster, rasterized
from instdrive_core.edits.ground_plane import ground_plane
from instdrive_core.edits.placement import SOLID_OPACITY
from instdrive_core.edits.sight import Occluder, sightings, standing
from instdrive_core.edits.surroundings import Neighborhood, Standing, Surroundings, standing_around
from instdrive_core.maths.rotations import matrix_from_quaternion, normalized

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
MAX_THICKNESS = 0.12
"""Metres: splats with a larger standard deviation along the vertical are no ground."""
MAX_SPLAT = 1.0
"""Metres: splats with a larger standard deviation along any axis are neither."""
SMOOTHING = 0.6
"""Cells: standard deviation of the average over neighbours."""
STANDING_BAND = (0.4, 2.5)
"""Metres above the plane at which something stands on the ground."""
MIN_COVER = 0.6
"""Share of light that solid ground stops."""
MIN_SIGHTINGS = 2
"""Photos that must show a place for its colour to be known."""
MAX_AWAY = 3.0
"""Metres from what was deleted that its hole reaches."""
PALETTE_ALONG, PALETTE_ACROSS = 5.0, 1.5
"""Metres along and across the lane within which known ground of a cell's colour must lie …"""
MAX_COLOR_DIFFERENCE = 0.1
"""… up to this difference of R, G or B, …"""
MIN_ALIKE = 5
"""… in so many cells."""
EDGE = 0.4
"""Metres around what stands on the ground that its paint and its darkness bleed into the ground."""
SHADOW_REACH = 2.0
"""Metres around what was deleted within which its shadow is looked for."""
SHADOW_SHARE = 0.65
"""Ground darker than this share of lit ground is in shadow."""
LIT_QUANTILE = 0.7
"""Of the brightness of ground along the lane: what is taken for lit."""
DARKEST_LIT = 0.8
"""Ground in the sun along any line is at least this share as bright as elsewhere."""
MIN_SHADOW = 0.4
"""Square metres: smaller dark places are stains."""
MIN_LIT = 50
"""Cells of ground that must be known to tell."""
FOREIGN_SHARE = 0.25
"""Of a dark place, outside of that reach, from which on it is not the shadow of what was deleted."""
MIN_AREA = 0.15
"""Square metres: smaller holes are gaps between splats."""
MAX_ISLAND = 0.6
"""Square metres of right-looking ground that a hole around it takes in."""
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
    """Never seen."""
    shadow: Int64[ndarray, "s 2"]
    """Seen, but in the shadow of what was deleted."""

    @property
    def area(self) -> float:
        """Square metres."""
        return len(self.cells) * self.grid.size**2

    @property
    def shadow_area(self) -> float:
        """Square metres."""
        return len(self.shadow) * self.grid.size**2

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
        hidden = uncovered = _grown(footprint, FOOTPRINT_MARGIN)
    edge = _grown(footprint, EDGE)
    candidates = ((hidden & uncovered & reached) | edge) & (footprint | ~ground.obstructed)
    clean = _solid(ground) & ~hidden & ~ground.obstructed & ~edge & ~_grown(_all_under(found.others, grid), EDGE)
    wrong = candidates & ~_plausible(ground, clean, candidates)
    missing = footprint & ~_solid(ground)
    hole = _large_parts(_closed(wrong, candidates, ground.obstructed) | missing, MIN_AREA)
    shadow = _cast_shadow(ground, clean, footprint, hole)
    return Hole(grid, np.argwhere(hole), np.argwhere(shadow))


def _closed(
    wrong: Bool[ndarray, "a b"], candidates: Bool[ndarray, "a b"], obstructed: Bool[ndarray, "a b"]
) -> Bool[ndarray, "a b"]:
    """With the cells at their edge, which seemed solid for the ground beside them, and those amid them that happen to
    look right."""
    grown = np.pad(np.asarray(ndimage.binary_dilation(wrong)), 3)
    closed = np.asarray(ndimage.binary_closing(grown, np.ones((3, 3)), iterations=2))[3:-3, 3:-3]
    whole = wrong | (closed & candidates)
    islands = np.asarray(ndimage.binary_fill_holes(whole), bool) & ~whole
    return whole | (islands & ~_large_parts(islands, MAX_ISLAND) & ~obstructed)


def _cast_shadow(
    ground: GroundMap, clean: Bool[ndarray, "a b"], footprint: Bool[ndarray, "a b"], hole: Bool[ndarray, "a b"]
) -> Bool[ndarray, "a b"]:
    """Dark ground that hangs together with the hole and ends close around what stood there.

    Shade that reaches farther is a house's or a tree's, and stays.
    """
    near = _grown(footprint, SHADOW_REACH)
    seen = _solid(ground) & ~ground.obstructed & ~hole
    if np.count_nonzero(clean) < MIN_LIT or not footprint.any():
        return np.zeros_like(hole)
    dark = seen & shaded(ground, clean)
    parts = np.zeros(hole.shape, np.int32)
    ndimage.label(dark, np.ones((3, 3)), parts)
    touching = np.unique(parts[dark & _grown(footprint | hole, 1.5 * CELL)])
    shadow = np.zeros_like(hole)
    for part in touching[touching > 0].tolist():
        cells = parts == part
        if np.count_nonzero(cells) * CELL**2 < MIN_SHADOW:
            continue
        if np.count_nonzero(cells & ~near) <= FOREIGN_SHARE * np.count_nonzero(cells):
            shadow |= cells & near
    # Its rim is half lit.
    return (_grown(shadow, CELL) & seen & near) if shadow.any() else shadow


def shaded(ground: GroundMap, clean: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    """Cells much darker than ground in the sun. Each line along the lane has its own: marks and pavements are brighter;
    yet a line is not taken to be dark because most of it is in shadow. `clean` ground is what is compared with."""
    brightness = ground.color.mean(axis=2)
    if not clean.any():
        return np.zeros_like(clean)
    everywhere = np.quantile(brightness[clean], LIT_QUANTILE)
    lit = np.full(clean.shape[1], everywhere)
    enough = clean.sum(axis=0) >= MIN_LIT // 2
    lines = np.where(clean, brightness, np.nan)[:, enough]
    lit[enough] = np.maximum(np.nanquantile(lines, LIT_QUANTILE, axis=0), DARKEST_LIT * everywhere)
    return brightness < SHADOW_SHARE * lit


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
    level = (heights >= GROUND_BAND[0]) & (heights <= GROUND_BAND[1])
    thin = _vertical_deviations(near) <= MAX_THICKNESS
    ground = level & thin & ~near.compact & (near.scales.max(axis=1) <= MAX_SPLAT)
    rows = np.flatnonzero(ground)
    values = np.c_[near.colors[rows], heights[rows]]
    raster = rasterized(grid, near.means[rows], near.quats[rows], near.scales[rows], near.opacities[rows], values)
    values = _smoothed(raster)
    solid = near.opacities >= SOLID_OPACITY
    upright = solid & (heights >= STANDING_BAND[0]) & (heights <= STANDING_BAND[1])
    counts = grid.counted(grid.cells_of(near.means[upright]))
    crowded = np.asarray(ndimage.uniform_filter(counts.astype(np.float64), 3, mode="constant")) * 9 >= 2
    return GroundMap(grid, raster.cover, raster.values[..., :3], raster.values[..., 3], crowded & (counts > 0), ground)


def _vertical_deviations(near: Neighborhood) -> Float64[ndarray, " k"]:
    """Standard deviation of each splat along z, metres."""
    turned = matrix_from_quaternion(normalized(near.quats))[:, 2] * near.scales
    return np.sqrt((turned.astype(np.float64) ** 2).sum(axis=1))


def _smoothed(raster: GroundRaster) -> Float64[ndarray, "a b v"]:
    """Values averaged over neighbouring cells by what covers them: cells between two lines of splats have some, too."""
    weights = ndimage.gaussian_filter(raster.cover, SMOOTHING, mode="nearest")
    sums = ndimage.gaussian_filter(raster.cover[..., None] * raster.values, (SMOOTHING, SMOOTHING, 0), mode="nearest")
    return np.asarray(sums) / np.maximum(weights, 1e-6)[..., None]


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
    if (seen >= MIN_SIGHTINGS).any():
        known &= (seen >= MIN_SIGHTINGS).reshape(grid.shape)
    return ground, known & ~_grown(_all_under(others, grid), EDGE)


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
    under, places = _all_under(deleted, grid), grid.centers(grid.all_cells())
    reached: Bool[ndarray, "a b"] = _grown(under, MAX_AWAY)
    for each in deleted:
        if each.track is not None:
            times = each.track.times
            path = np.stack([each.track.pose_at(time)[:2, 3] for time in times[:: max(1, len(times) // 20)]])
            gaps = np.linalg.norm(places[:, None] - path[None], axis=-1).min(axis=1)
            reached = reached | (gaps <= MAX_AWAY).reshape(grid.shape)
    return under, reached


def _all_under(standing: Sequence[Standing], grid: GroundGrid) -> Bool[ndarray, "a b"]:
    """Cells under any of the objects that do not move."""
    under, places = np.zeros(grid.shape, bool), grid.centers(grid.all_cells())
    for each in standing:
        if each.track is None:
            under |= _under(each, places).reshape(grid.shape)
    return under


def _grown(cells: Bool[ndarray, "a b"], metres: float) -> Bool[ndarray, "a b"]:
    """With all cells up to some metres away."""
    return _distances(~cells) * CELL <= metres if cells.any() else cells


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


def _plausible(ground: GroundMap, known: Bool[ndarray, "a b"], asked: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    """Cells of those `asked` whose ground is solid and of a colour that enough of the known ground around has, too."""
    along, across = round(PALETTE_ALONG / ground.grid.size), round(PALETTE_ACROSS / ground.grid.size)
    margin, window = ((along, along), (across, across)), (2 * along + 1, 2 * across + 1)
    # Unknown ground is like nothing.
    colors = np.pad(np.where(known[..., None], ground.color, np.inf), (*margin, (0, 0)), constant_values=np.inf)
    around = sliding_window_view(colors, window, (0, 1))
    plausible = np.zeros(known.shape, bool)
    for cell in np.argwhere(asked & _solid(ground)):
        differences = np.abs(around[tuple(cell)] - ground.color[tuple(cell)][:, None, None]).max(axis=0)
        plausible[tuple(cell)] = np.count_nonzero(differences <= MAX_COLOR_DIFFERENCE) >= MIN_ALIKE
    return plausible


def _large_parts(cells: Bool[ndarray, "a b"], area: float) -> Bool[ndarray, "a b"]:
    """The parts of at least so many square metres."""
    parts = np.zeros(cells.shape, np.int32)
    ndimage.label(cells, np.ones((3, 3)), parts)
    return cells & (np.bincount(parts.ravel())[parts] * CELL**2 >= area)
