"""Ground that no photo showed because a thing that moves, such as the car in front, hid it all the time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.edits.holes.free_space import MAX_DISTANCE
from instdrive_core.edits.holes.ground_cells import find_covered_cells, keep_large_parts
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_in_photo import project_ground
from instdrive_core.edits.holes.ground_map import build_ground_map, find_walls
from instdrive_core.edits.holes.holes import MIN_AREA, Hole, build_ground_grid, find_bare_cells, is_free_way
from instdrive_core.edits.holes.photo_evidence import Look
from instdrive_core.edits.holes.surroundings import StandingObject, Surroundings

LONGEST = 16.0
"""Metres along the lane of the ground of one map: less than it shows, so that enough is known around."""
FEWEST = 6
"""Pixels of all looks that must show bare ground on a map."""


def look_up_to_walls(looks: Sequence[Look], grid: GroundGrid, around: Surroundings) -> list[Look]:
    """Close the open pixels of looks beyond which ground would lie behind the walls around.

    Where a wall has a gap of its own, such as behind somebody who walks along a house, one would look through it at
    ground that never was there.

    Args:
        looks: those at something that moves.
        grid: cells around it, on the ground.
        around: it, and what stands there.
    """
    walls, closed = find_walls(grid, around.around), list[Look]()
    for look in looks:
        lines, columns, points = _find_bare_points(look, grid.plane)
        blocked = ~is_free_way(grid, walls, look.place, look.camera.position, points)
        open_ = look.open.copy()
        open_[lines[blocked], columns[blocked]] = False
        closed.append(replace(look, open=open_))
    return closed


def find_bare_places(
    looks: Sequence[Look], plane: tuple[float, float, float], along: tuple[float, float]
) -> list[Float64[ndarray, "3"]]:
    """Find the middles of the ground that looks would show bare, metres, one for each stretch of the lane.

    Args:
        plane: height of the ground at the world's origin (metres) and its slopes along x and y.
        along: unit vector of the lane.
    """
    found = [_find_bare_points(look, plane)[2] for look in looks]
    points = np.concatenate([np.zeros((0, 3)), *found])
    points = points[np.argsort(points[:, :2] @ np.array(along), kind="stable")]
    places = []
    while len(points):
        ahead = points[:, :2] @ np.array(along)
        count = int(np.searchsorted(ahead, ahead[0] + LONGEST, "right"))
        if count >= FEWEST:
            places.append((points[:count].min(axis=0) + points[:count].max(axis=0)) / 2)
        points = points[count:]
    return places


def find_bare_hole(
    found: Surroundings, looks: Sequence[Look], earlier: Sequence[Hole], beside: Sequence[StandingObject]
) -> Hole | None:
    """The ground of a map that looks would show bare; None where there is none.

    What `earlier` holes have, and what lies below things that were deleted `beside` it, does not count.
    """
    grid = build_ground_grid(found)
    if grid is None:
        return None
    ground = build_ground_map(grid, found.around)
    bare = find_bare_cells(grid, ground, found.around, looks, None) & ~ground.obstructed
    bare &= ~find_covered_cells(beside, grid)
    cells = np.argwhere(keep_large_parts(bare, grid.size, MIN_AREA))
    for hole in earlier:
        taken = {*map(tuple, np.concatenate([hole.cells, hole.shadow]).tolist())}
        there = hole.grid.find_cells(grid.compute_centers(cells))
        cells = cells[[tuple(cell) not in taken for cell in there.tolist()]]
    instances = tuple(sorted(each.body.instance for each in beside))
    return Hole(grid, cells, cells[:0], beside=instances) if len(cells) else None


def _find_bare_points(
    look: Look, plane: tuple[float, float, float]
) -> tuple[Int64[ndarray, " k"], Int64[ndarray, " k"], Float64[ndarray, "k 3"]]:
    """Lines and columns of the open pixels of a look, and where they meet the ground beyond where the thing begins."""
    camera, distances = look.camera, project_ground(look.camera, plane).distances
    lines, columns = np.nonzero(look.open & (distances >= look.nearest) & (distances <= MAX_DISTANCE))
    depths = distances[lines, columns]
    x = (columns + 0.5 - camera.cx) / camera.fx * depths
    y = (lines + 0.5 - camera.cy) / camera.fy * depths
    pose = camera.world_from_camera
    return lines, columns, np.stack([x, y, depths], axis=1) @ pose[:3, :3].T + pose[:3, 3]
