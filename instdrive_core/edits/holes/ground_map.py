"""What the ground around a place looks like from above, and where something stands on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.ground_grid import GroundGrid, GroundRaster, rasterize_ground
from instdrive_core.edits.holes.surroundings import Neighborhood
from instdrive_core.edits.queries.placement import SOLID_OPACITY
from instdrive_core.maths.rotations import matrix_from_quaternion, normalize_quaternions

GROUND_BAND = (-0.12, 0.3)
"""Metres above the plane between which ground lies: kerbs and pavements included."""
MAX_THICKNESS = 0.12
"""Metres: splats with a larger standard deviation along the vertical are no ground."""
MAX_SPLAT = 1.0
"""Metres: splats with a larger standard deviation along any axis are neither."""
BARE = 0.1
"""Cells that are covered less have no colour of their own …"""
SMOOTHING = 0.8
"""… but an average over their neighbours with this standard deviation in cells."""
STANDING_BAND = (0.4, 2.5)
"""Metres above the plane at which something stands on the ground."""
WALL_BAND = (0.4, 6.0)
"""Metres above the plane at which walls are looked for: cars hide their lower part."""
WALL_SHARE = 0.35
"""Share of a line along the lane in which something must stand for it to be a wall's, gates and gaps included."""
WALL_GAP = 4.0
"""Metres along the lane: two pieces of a wall that are nearer to each other are one."""
MIN_COVER = 0.6
"""Share of light that solid ground stops."""


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
    """Mask of the neighbourhood's splats that make up the ground."""


def build_ground_map(grid: GroundGrid, near: Neighborhood) -> GroundMap:
    """Find the splats that are ground, and how the ground looks from above."""
    heights, ground = grid.compute_heights(near.means), find_ground_splats(grid, near)
    rows = np.flatnonzero(ground)
    values = np.c_[near.colors[rows], heights[rows]]
    raster = rasterize_ground(grid, near.means[rows], near.quats[rows], near.scales[rows], near.opacities[rows], values)
    means = _fill_bare_cells(raster)
    opaque = near.opacities >= SOLID_OPACITY
    upright = opaque & (heights >= STANDING_BAND[0]) & (heights <= STANDING_BAND[1])
    counts = grid.count_cells(grid.find_cells(near.means[upright]))
    crowded = np.asarray(ndimage.uniform_filter(counts.astype(np.float64), 3, mode="constant")) * 9 >= 2
    return GroundMap(grid, raster.cover, means[..., :3], means[..., 3], crowded & (counts > 0), ground)


def find_ground_splats(grid: GroundGrid, near: Neighborhood) -> Bool[ndarray, " k"]:
    """Splats that are thin, lie near the plane and are part of nothing that stands there."""
    heights = grid.compute_heights(near.means)
    level = (heights >= GROUND_BAND[0]) & (heights <= GROUND_BAND[1])
    thin = _compute_vertical_deviations(near) <= MAX_THICKNESS
    return level & thin & ~near.compact & (near.scales.max(axis=1) <= MAX_SPLAT)


def _compute_vertical_deviations(near: Neighborhood) -> Float64[ndarray, " k"]:
    """Standard deviation of each splat along z, metres."""
    turned = matrix_from_quaternion(normalize_quaternions(near.quats))[:, 2] * near.scales
    return np.sqrt((turned.astype(np.float64) ** 2).sum(axis=1))


def _fill_bare_cells(raster: GroundRaster) -> Float64[ndarray, "a b v"]:
    """Values of covered cells, and of bare ones the neighbours': cells between two lines of splats have some, too."""
    weights = ndimage.gaussian_filter(raster.cover, SMOOTHING, mode="nearest")
    sums = ndimage.gaussian_filter(raster.cover[..., None] * raster.values, (SMOOTHING, SMOOTHING, 0), mode="nearest")
    means = np.asarray(sums) / np.maximum(weights, 1e-6)[..., None]
    return np.where((raster.cover >= BARE)[..., None], raster.values, means)


def find_solid_cells(ground: GroundMap) -> Bool[ndarray, "a b"]:
    """Cells with solid ground in them or close around: it may lie in lines, as a LiDAR saw it."""
    return np.asarray(ndimage.uniform_filter(ground.cover, 3, mode="nearest")) >= MIN_COVER / 2


def find_walls(grid: GroundGrid, near: Neighborhood) -> Bool[ndarray, "a b"]:
    """Find the cells in which walls, fences or hedges stand along the lane, whatever hides a part of them."""
    broad = _find_upright_cells(grid, near, WALL_BAND, ~near.compact)
    length = round(WALL_GAP / grid.size)
    padded = np.pad(broad, ((length, length), (0, 0)))
    pieces = np.asarray(ndimage.binary_closing(padded, np.ones((length, 1))), bool)[length:-length]
    return _choose_wall_lines(broad) | pieces


def find_cells_before_walls(
    grid: GroundGrid, near: Neighborhood, footprint: Bool[ndarray, "a b"]
) -> Bool[ndarray, "a b"]:
    """Find the cells on the side of the walls on which most of a footprint lies, and the walls'.

    Walls are found below the crowns of trees, and narrow houses count, too. All cells where the whole footprint lies
    in walls: then it tells no side.
    """
    walls = _choose_wall_lines(_find_upright_cells(grid, near, STANDING_BAND, ~near.compact | near.tall))
    parts = np.zeros(walls.shape, np.int32)
    ndimage.label(~walls, output=parts)
    shares = np.bincount(parts[footprint & ~walls])
    return walls | (parts == np.argmax(shares)) if len(shares) else np.ones_like(walls)


def _find_upright_cells(
    grid: GroundGrid, near: Neighborhood, band: tuple[float, float], among: Bool[ndarray, " k"]
) -> Bool[ndarray, "a b"]:
    """Cells in which, or beside which across the lane, solid splats stand in a band of heights (metres)."""
    heights = grid.compute_heights(near.means)
    upright = among & (near.opacities >= SOLID_OPACITY) & (near.scales.max(axis=1) <= MAX_SPLAT)
    upright &= (heights >= band[0]) & (heights <= band[1])
    taken = grid.count_cells(grid.find_cells(near.means[upright])) > 0
    return np.asarray(ndimage.maximum_filter1d(taken.astype(np.uint8), 3, axis=1), bool)


def _choose_wall_lines(upright: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    return np.broadcast_to(upright.mean(axis=0) >= WALL_SHARE, upright.shape)
