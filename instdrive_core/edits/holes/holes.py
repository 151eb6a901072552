"""Holes: ground that no photo showed, because a thing that is deleted now stood in front of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.cast_shadow import HALF_LIT_SHARE, find_cast_shadow, find_shaded_cells, lies_in_shade
from instdrive_core.edits.holes.free_space import Occluder, build_occluder, count_sightings
from instdrive_core.edits.holes.ground_cells import find_covered_cells, find_nearer_cells, grow_cells, keep_large_parts
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_map import (
    BARE,
    GroundMap,
    build_ground_map,
    find_cells_before_walls,
    find_solid_cells,
    find_walls,
)
from instdrive_core.edits.holes.ground_plane import fit_ground_plane, keep_topmost
from instdrive_core.edits.holes.kept_footprint import find_kept_footprint
from instdrive_core.edits.holes.lanes.road_direction import find_road_direction
from instdrive_core.edits.holes.photo_evidence import Look
from instdrive_core.edits.holes.surroundings import Neighborhood, StandingObject, Surroundings, find_standing_objects
from instdrive_core.edits.queries.compact_objects import is_tall
from instdrive_core.edits.queries.placement import SOLID_OPACITY

CELL = 0.2
"""Metres per side of a cell."""
HALF_LENGTH, HALF_WIDTH = 12.0, 7.0
"""Metres along and across the lane that the map reaches from the middle."""
PLANE_RADIUS = 8.0
"""Metres around the middle that the ground plane is fitted to."""
PLANE_BAND = 2.5
"""Metres below the middle of what stood there, and above, that ground is looked for."""
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
DARK_RIM = 0.4
"""Metres around a hole within which dark ground, the contact shadow's rim, belongs to it."""
HALF_LIT = 0.4
"""Metres around that rim, in the sun, within which its soft edge belongs to the hole, too: what is half dark beside a
hole makes the whole fill darker."""
MIN_AREA = 0.15
"""Square metres: smaller holes are gaps between splats."""
BARE_COVER = 0.5
"""Share of light that cells stop at most through which the sky would show."""
MAX_ISLAND = 0.6
"""Square metres of right-looking ground that a hole around it takes in."""
LEAST_KNOWN = 1.0
"""Metres of a line along the lane from which it is known what the ground there is like."""
LINE_GAP = 0.8
"""Metres between the lines in which a LiDAR meets the ground."""
FOOTPRINT_MARGIN = 0.15
"""Metres around the footprint of what was deleted, where no photos say what is hidden."""


@dataclass(frozen=True)
class Hole:
    """Ground cells to be filled."""

    grid: GroundGrid
    cells: Int64[ndarray, "h 2"]
    """Never seen."""
    shadow: Int64[ndarray, "s 2"]
    """Seen, but in the shadow of what was deleted."""
    behind: tuple[int, ...] = ()
    """Deleted instances that hid more than ground from all photos."""
    beside: tuple[int, ...] = ()
    """Deleted instances around, whose own holes are not filled: what lies there is no ground to copy."""

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
        return self.grid.compute_corners(self.cells)


def find_hole(
    found: Surroundings,
    residue: Int64[ndarray, " r"],
    looks: Sequence[Look] = (),
    behind: tuple[int, ...] = (),
    beside: Sequence[StandingObject] = (),
) -> Hole | None:
    """The ground that a deletion uncovers and no photo showed; None where there is no ground around.

    `residue` are rows that are left of what was deleted, or that no photo showed: they neither cover the ground nor
    stand on it. `looks` are the photos that show what was deleted, `behind` the instances that hid more than ground,
    and things that were deleted `beside` it have holes of their own.
    """
    around = found.around.exclude(residue)
    grid = build_ground_grid(replace(found, around=around))
    if grid is None:
        return None
    ground = build_ground_map(grid, around)
    kept = find_kept_footprint(found.kept, grid)
    kept |= find_nearer_cells(find_covered_cells(beside, grid), find_covered_cells(found.deleted, grid))
    footprint, reached = _find_footprints(grid, found.deleted, kept)
    before = find_cells_before_walls(grid, around, footprint)
    footprint, reached = footprint & before, reached & before
    hidden, uncovered = _find_hidden_cells(grid, found, beside)
    if hidden is None:
        hidden = uncovered = grow_cells(footprint, grid.size, FOOTPRINT_MARGIN)
    edge = grow_cells(footprint, grid.size, EDGE)
    candidates = ((hidden & uncovered & reached) | edge) & (footprint | ~ground.obstructed) & ~kept
    stained = edge | grow_cells(find_covered_cells(found.others, grid) | kept, grid.size, EDGE)
    clean = find_solid_cells(ground) & ~hidden & ~ground.obstructed & ~stained
    wrong = candidates & ~_find_plausible_cells(ground, clean, candidates)
    missing = footprint & ~find_solid_cells(ground)
    closed = _close_gaps(wrong, candidates, ground.obstructed | kept, grid.size)
    bare = find_bare_cells(grid, ground, around, looks, found.place) & (footprint | ~ground.obstructed) & ~kept
    hole = keep_large_parts(closed | missing | bare, grid.size, MIN_AREA)
    shaded, free = find_shaded_cells(ground, clean), find_solid_cells(ground) & ~ground.obstructed & ~kept
    rim = grow_cells(hole, grid.size, DARK_RIM) & shaded & free
    hole = hole | rim
    shadow = find_cast_shadow(ground, clean, footprint, hole)
    if not lies_in_shade(shaded, clean, hole, grid.size):
        dimmed = free & find_shaded_cells(ground, clean, HALF_LIT_SHARE)
        edge = grow_cells(rim, grid.size, HALF_LIT) & grow_cells(free & ~dimmed, grid.size, HALF_LIT)
        hole = hole | (dimmed & edge & ~shadow)
    instances = tuple(sorted(each.body.instance for each in beside))
    return Hole(grid, np.argwhere(hole), np.argwhere(shadow), behind, instances)


def find_bare_cells(
    grid: GroundGrid, ground: GroundMap, near: Neighborhood, looks: Sequence[Look], place: Float64[ndarray, "3"] | None
) -> Bool[ndarray, "a b"]:
    """Cells without ground that a photo would show where it showed what was deleted, up to what stands behind.

    `place` is where that stood (metres); None where it moves: each look then has a place of its own.
    """
    points = grid.lift_to_ground(grid.compute_centers(grid.list_cells()))
    shown = np.zeros(len(points), bool)
    walls = ground.obstructed | find_walls(grid, near)
    for look in looks:
        pixels, depths = look.camera.project(points)
        columns, lines = np.floor(np.where(depths[:, None] > 0, pixels, -1)).clip(-1, 1 << 20).astype(np.int64).T
        height, width = look.silhouette.shape
        framed = (depths > 0) & (columns >= 0) & (columns < width) & (lines >= 0) & (lines < height)
        hit = np.flatnonzero(framed & ~shown)
        hit = hit[look.open[lines[hit], columns[hit]]]
        start = look.place if place is None else place
        shown[hit[is_free_way(grid, walls, start, look.camera.position, points[hit])]] = True
    bare = np.asarray(ndimage.binary_closing(shown.reshape(grid.shape), np.ones((3, 3))), bool)
    return bare & (ground.cover < BARE_COVER)


def is_free_way(
    grid: GroundGrid,
    walls: Bool[ndarray, "a b"],
    place: Float64[ndarray, "3"],
    eye: Float64[ndarray, "3"],
    points: Float64[ndarray, "n 3"],
) -> Bool[ndarray, " n"]:
    """Whether no wall stands between the place of what was deleted and each point, seen from `eye`, from above."""
    free = np.ones(len(points), bool)
    start = np.linalg.norm(place[:2] - eye[:2])
    offsets = points[:, :2] - eye[:2]
    lengths = np.linalg.norm(offsets, axis=1)
    for distance in np.arange(start, lengths.max(initial=0.0), grid.size):
        on_way = np.flatnonzero(free & (lengths > distance + grid.size))
        cells = grid.find_cells(eye[:2] + offsets[on_way] * (distance / lengths[on_way])[:, None])
        inside = grid.contains(cells)
        free[on_way[inside][walls[tuple(cells[inside].T)]]] = False
    return free


def _close_gaps(
    wrong: Bool[ndarray, "a b"], candidates: Bool[ndarray, "a b"], obstructed: Bool[ndarray, "a b"], size: float
) -> Bool[ndarray, "a b"]:
    """Add the cells at the edge, which seemed solid because of the ground beside them, and enclosed cells that look
    right by chance."""
    grown = np.pad(np.asarray(ndimage.binary_dilation(wrong)), 3)
    closed = np.asarray(ndimage.binary_closing(grown, np.ones((3, 3)), iterations=2))[3:-3, 3:-3]
    whole = wrong | (closed & candidates)
    islands = np.asarray(ndimage.binary_fill_holes(whole), bool) & ~whole
    return whole | (islands & ~keep_large_parts(islands, size, MAX_ISLAND) & ~obstructed)


def build_ground_grid(found: Surroundings) -> GroundGrid | None:
    """Cells along the lane, on the plane of the ground; None where there are too few splats for one."""
    near = found.around
    offsets = near.means - found.place.astype(np.float32)
    solid = (near.opacities >= SOLID_OPACITY) & ~near.compact & (np.abs(offsets[:, 2]) <= PLANE_BAND)
    solid &= np.hypot(offsets[:, 0], offsets[:, 1]) <= PLANE_RADIUS
    low = offsets[solid & (offsets[:, 2] <= 0)]
    # Walls all around: what stood there stood on what lies below its middle. And the road may hide splats below it.
    tries = (offsets[solid], low, keep_topmost(low))
    plane = next((found for found in map(fit_ground_plane, tries) if found is not None), None)
    if plane is not None:
        level = float(found.place[2] + plane[0] - plane[1:] @ found.place[:2])
        in_world = (level, float(plane[1]), float(plane[2]))
    elif found.plane is not None:
        in_world = found.plane
    else:
        return None
    shape = (round(2 * HALF_LENGTH / CELL), round(2 * HALF_WIDTH / CELL))
    grid = GroundGrid((0.0, 0.0), found.along, CELL, shape, in_world)
    grid = replace(grid, along=find_road_direction(grid, near))
    x, y = (found.place[:2] - np.array([HALF_LENGTH, HALF_WIDTH]) @ grid.axes).tolist()
    return replace(grid, corner=(x, y))


def find_known_ground(
    document: Document,
    grid: GroundGrid,
    near: Neighborhood,
    hole: Bool[ndarray, "a b"],
    beside: Sequence[StandingObject] = (),
) -> tuple[GroundMap, Bool[ndarray, "a b"]]:
    """The ground as it is now, and where it is known: solid, free, and shown by enough photos where any are.

    Around a `hole` in the sun, ground in the shadow of what else stands there is left out: where cars are parked in a
    row, their shadows are all that is known on a line, and none of them falls into the hole. Of what was deleted
    `beside` it, photos showed the ground no better than if it still stood there.
    """
    ground = build_ground_map(grid, near)
    table = document.scene.table
    # Hulls of houses and trees reach over the ground before them and below.
    standing = (*find_standing_objects(document, near), *beside)
    others = tuple(each for each in standing if not is_tall(table[each.body.instance]))
    occluders = [each for each in (_make_occluder(one, grid) for one in others) if each is not None]
    points = grid.lift_to_ground(grid.compute_centers(grid.list_cells()))
    seen, _ = count_sightings(points, document.scene.views, occluders, 0)
    under = find_covered_cells(others, grid)
    free = ~ground.obstructed & ~grow_cells(under, grid.size, EDGE)
    known = find_solid_cells(ground) & free
    if (seen >= MIN_SIGHTINGS).any():
        known &= (seen >= MIN_SIGHTINGS).reshape(grid.shape)
    if not lies_in_shade(find_shaded_cells(ground, known), known, hole, grid.size):
        free &= hole | ~find_cast_shadow(ground, known, under, under)
        known &= free
    return ground, known | (_find_hearsay(ground, known) & free)


def _find_hearsay(ground: GroundMap, known: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    """Cells on lines along the lane of which nothing is known, such as a pavement behind parked cars, that lie on or
    between splats of ground: better the pavement as few photos saw it than the road in its place."""
    unknown = known.sum(axis=0) * ground.grid.size < LEAST_KNOWN
    size = 2 * round(LINE_GAP / ground.grid.size / 2) + 1
    padded = np.pad(ground.cover >= BARE, size)
    closed = np.asarray(ndimage.binary_closing(padded, np.ones((size, size))), bool)
    return unknown & closed[size:-size, size:-size]


def _find_hidden_cells(
    grid: GroundGrid, found: Surroundings, beside: Sequence[StandingObject]
) -> tuple[Bool[ndarray, "a b"] | None, Bool[ndarray, "a b"]]:
    """Cells that fewer than `MIN_SIGHTINGS` photos show, and those that the deleted objects hid from any; None where
    there are no photos around to tell."""
    points = grid.lift_to_ground(grid.compute_centers(grid.list_cells()))
    occluders = [_make_occluder(each, grid) for each in (*found.deleted, *found.others, *beside)]
    chosen = sum(each is not None for each in occluders[: len(found.deleted)])
    seen, hidden = count_sightings(points, found.views, [each for each in occluders if each is not None], chosen)
    away = np.linalg.norm(points[:, :2] - found.place[:2], axis=1)
    if not (seen[away < MAX_AWAY + 2] > 0).any():
        return None, np.zeros(grid.shape, bool)
    return (seen < MIN_SIGHTINGS).reshape(grid.shape), (hidden > 0).reshape(grid.shape)


def _make_occluder(each: StandingObject, grid: GroundGrid) -> Occluder | None:
    if each.track is None:
        floor = float(grid.lift_to_ground(each.body.center[None, :2])[0, 2])
    else:
        floor = -float(each.track.dimensions[2]) / 2
    return build_occluder(each.body, each.points, floor, each.track)


def _find_footprints(
    grid: GroundGrid, deleted: tuple[StandingObject, ...], kept: Bool[ndarray, "a b"]
) -> tuple[Bool[ndarray, "a b"], Bool[ndarray, "a b"]]:
    """Cells under the hulls of what stood there and not under what is `kept` of it, and those within `MAX_AWAY` of
    them. Where an actor drove is none of its footprint: photos before and after show it."""
    under, places = find_covered_cells(deleted, grid) & ~kept, grid.compute_centers(grid.list_cells())
    reached: Bool[ndarray, "a b"] = grow_cells(under, grid.size, MAX_AWAY)
    for each in deleted:
        if each.track is not None:
            times = each.track.times
            path = each.track.interpolate_poses(times[:: max(1, len(times) // 20)])[:, :2, 3]
            gaps = np.linalg.norm(places[:, None] - path[None], axis=-1).min(axis=1)
            reached = reached | (gaps <= MAX_AWAY).reshape(grid.shape)
    return under, reached


def _find_plausible_cells(
    ground: GroundMap, known: Bool[ndarray, "a b"], asked: Bool[ndarray, "a b"]
) -> Bool[ndarray, "a b"]:
    """Cells of those `asked` whose ground is solid and of a colour that enough of the known ground around has, too."""
    along, across = round(PALETTE_ALONG / ground.grid.size), round(PALETTE_ACROSS / ground.grid.size)
    asked = asked & find_solid_cells(ground)
    return _find_alike(np.ascontiguousarray(ground.color), known, asked, along, across)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_alike(
    colors: Float64[ndarray, "a b 3"], known: Bool[ndarray, "a b"], asked: Bool[ndarray, "a b"], along: int, across: int
) -> Bool[ndarray, "a b"]:
    """Which of the cells `asked` have a colour that enough `known` cells have that lie so many cells away at most."""
    alike = np.zeros(known.shape, np.bool_)
    for i in range(known.shape[0]):
        for j in range(known.shape[1]):
            if not asked[i, j]:
                continue
            count = 0
            for k in range(max(i - along, 0), min(i + along + 1, known.shape[0])):
                for m in range(max(j - across, 0), min(j + across + 1, known.shape[1])):
                    if known[k, m]:
                        difference = 0.0
                        for channel in range(3):
                            difference = max(difference, abs(colors[k, m, channel] - colors[i, j, channel]))
                        if difference <= MAX_COLOR_DIFFERENCE:
                            count += 1
                if count >= MIN_ALIKE:
                    break
            alike[i, j] = count >= MIN_ALIKE
    return alike
