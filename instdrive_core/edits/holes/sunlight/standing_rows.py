"""What stands along a stretch of street: solid points that throw shadows, and on either side a row of houses.

Photos show the fronts of houses and seldom their roofs, so that a seen top is only a lower bound of a height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.scene.camera import Camera

LEVEL = 0.25
"""Metres between two heights that are told apart."""
HEIGHTS = LEVEL * (np.arange(80) + 0.5)
"""Metres."""
LOWEST = 0.35
"""Metres above the ground from which on points stand."""
SHEET = (1.5, 3.5)
"""Metres above the ground between which fronts of houses are whole, crowns and trunks of trees are not: …"""
SHEET_PART, SHEET_SHARE = 0.5, 0.7
"""… in this share of such parts, metres, there is something."""
FRONT_GAP, LEAST_FRONT = 3.0, 3.0
"""Metres along the lane: gaps of a front that are closed, and what is too short for one."""
MAIN_SHARE = 0.7
"""A front is at least this share as high as its house: balconies and signs stand before it."""
FARTHEST = 50.0
"""Metres from which a photo would still show the top of a house."""


@dataclass(frozen=True)
class StandingRows:
    """What stands on a grid of the ground, whose first half across is one side of the street."""

    grid: GroundGrid
    places: Float64[ndarray, "n 2"]
    """Metres along and across, from the grid's corner, of solid points, …"""
    heights: Float64[ndarray, " n"]
    """… and above the ground."""
    walls: Bool[ndarray, "a b"]
    fronts: Int64[ndarray, "2 a"]
    """Cell across from which on houses stand; outside of the grid where there is none."""
    tops: Float64[ndarray, "2 a"]
    """Metres up to which the row was seen; 0 where there is none."""
    framed: Float64[ndarray, "2 a h"]
    """How many photos would show a front of each of `HEIGHTS`."""


def find_standing_rows(
    grid: GroundGrid, places: Float64[ndarray, "n 2"], heights: Float64[ndarray, " n"], cameras: Sequence[Camera]
) -> StandingRows:
    """Find fronts among solid points: metres along and across from the grid's corner, and above the ground."""
    solid = heights > LOWEST
    places, heights = places[solid], heights[solid]
    tops = np.zeros(grid.shape)
    cells = np.floor(places / grid.size).astype(np.int64)
    inside = grid.contains(cells)
    np.maximum.at(tops, tuple(cells[inside].T), heights[inside])
    sheets = _find_sheets(grid, cells[inside], heights[inside])
    walls, fronts = np.zeros(grid.shape, bool), np.zeros((2, grid.shape[0]), np.int64)
    seen = np.zeros((2, grid.shape[0]))
    gap, half = round(FRONT_GAP / grid.size), grid.shape[1] // 2
    for side, columns in enumerate((slice(0, half), slice(half, None))):
        mine = tops[:, columns] * sheets[:, columns]
        seen[side] = ndimage.median_filter(mine.max(axis=1), 2 * (gap // 4) + 1)
        main = (mine > 0) & (mine >= MAIN_SHARE * ndimage.maximum_filter(seen[side], gap)[:, None])
        walls[:, columns] = _close_along(main, gap)
        fronts[side] = _find_fronts(walls, side, half)
    return StandingRows(grid, places, heights, walls, fronts, seen, _count_frames(grid, fronts, cameras))


def _find_sheets(grid: GroundGrid, cells: Int64[ndarray, "n 2"], heights: Float64[ndarray, " n"]) -> ndarray:
    """Cells in which something stands at nearly every height of `SHEET`, in pieces long enough for a house."""
    parts = np.arange(SHEET[0], SHEET[1], SHEET_PART)
    full = np.zeros(grid.shape)
    for low in parts:
        count = grid.count_cells(cells[(heights >= low) & (heights < low + SHEET_PART)]) > 0
        full += ndimage.maximum_filter(count, 3)
    sheets = (full >= SHEET_SHARE * len(parts)) & (grid.count_cells(cells) > 0)
    long = round(LEAST_FRONT / grid.size)
    broad = np.asarray(ndimage.maximum_filter1d(_close_along(sheets, long), 3, axis=1), bool)
    return sheets & np.asarray(ndimage.binary_opening(broad, np.ones((long, 1))), bool)


def _close_along(cells: Bool[ndarray, "a b"], length: int) -> Bool[ndarray, "a b"]:
    padded = np.pad(cells, ((length, length), (0, 0)))
    closed = np.asarray(ndimage.binary_closing(padded, np.ones((length, 1))), bool)[length:-length]
    return cells | closed


def _find_fronts(walls: Bool[ndarray, "a b"], side: int, half: int) -> Int64[ndarray, " a"]:
    mine = walls[:, half - 1 :: -1] if side == 0 else walls[:, half:]
    first = mine.argmax(axis=1)
    cells = half - 1 - first if side == 0 else half + first
    return np.where(mine.any(axis=1), cells, -(10**6) if side == 0 else 10**6)


def _count_frames(
    grid: GroundGrid, fronts: Int64[ndarray, "2 a"], cameras: Sequence[Camera]
) -> Float64[ndarray, "2 a h"]:
    """Photos whose frame holds each height of each front."""
    counts = np.zeros((*fronts.shape, len(HEIGHTS)))
    for side in (0, 1):
        there = np.flatnonzero(np.abs(fronts[side]) < 10**6)
        feet = grid.lift_to_ground(grid.compute_centers(np.c_[there, fronts[side][there]]))
        points = np.repeat(feet, len(HEIGHTS), axis=0)
        points[:, 2] += np.tile(HEIGHTS, len(feet))
        for camera in cameras:
            pixels, depths = camera.project(points)
            held = (depths > 0) & (np.linalg.norm(points - camera.position, axis=1) <= FARTHEST)
            held &= (pixels > 0).all(axis=1) & (pixels < (camera.width, camera.height)).all(axis=1)
            counts[side, there] += held.reshape(len(feet), len(HEIGHTS))
    return counts
