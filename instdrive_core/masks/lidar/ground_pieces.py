"""Pieces of the ground that kerbs part: the road, pavements, islands.

The ground is flooded from where it is level, as water fills basins between ridges (`ground_steps` are the ridges), and
basins are joined unless most of their border is a step to the same side. So a driveway, level with the road and with
the pavement, joins neither to the other. What cars and poles cut off is joined across the gap where the ground goes on.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy import ndimage
from scipy.spatial import KDTree
from skimage.measure import label
from skimage.segmentation import watershed

from instdrive_core.masks.lidar.ground_meetings import Meeting, Meetings, join_level, measure_borders, measure_gaps
from instdrive_core.masks.lidar.ground_steps import measure_ground_steps

CELL = 0.25
"""Metres along an edge of a cell: pavements are several cells wide, and a few sweeps fill one."""
LEVEL, LEAST_BASIN = 0.02, 1.0
"""Metres below which a step is none, and square metres of such ground that a basin starts from."""
PASSAGE = 4.0
"""Metres across level ground from which on it is open, and no passage between a road and a pavement."""
LEAST_AREA = 5.0
"""Square metres: smaller pieces go to what lies around."""
LEAST_KERB = 0.5
"""Metres of kerb to larger pieces, for each metre along an edge of a square of its area, that part a piece from them:
pavements have several. A side street that a parked car hides the mouth of may seem to begin higher."""
FARTHEST = 45.0
"""Metres from the sensor's path up to which kerbs are looked for: beyond, beams lie too far apart."""


@dataclass(frozen=True)
class GroundPieces:
    """A number for each cell of a grid over the ground, counted from 0, the largest piece's first."""

    corner: Float64[ndarray, "2"]
    """x and y of the grid's corner."""
    numbers: Int64[ndarray, "x y"]

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self.numbers.max(initial=0)) + 1

    @property
    def borders(self) -> Bool[ndarray, "x y"]:
        """The cells beside another piece: the border lies in one of them, or between."""
        highest = ndimage.maximum_filter(self.numbers, 3, mode="nearest")
        return np.asarray(highest != ndimage.minimum_filter(self.numbers, 3, mode="nearest"), bool)

    def find(self, points: Float32[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
        """Find the piece that points lie on, outside of the grid the one at its rim; -1 on a border."""
        cells = np.floor((points[:, :2] - self.corner) / CELL).astype(np.int64)
        rows, columns = np.clip(cells, 0, np.array(self.numbers.shape) - 1).T
        return np.where(self.borders, -1, self.numbers)[rows, columns]


def part_ground(points: Float32[ndarray, "n 3"], path: Float64[ndarray, "s 3"]) -> GroundPieces:
    """Part the ground where it steps.

    Args:
        points: of the ground, in a world whose z axis points up.
        path: where the sensor was.
    """
    corner = path[:, :2].min(axis=0) - FARTHEST
    rows, columns = np.ceil((path[:, :2].max(axis=0) + FARTHEST - corner) / CELL).astype(int).tolist()
    heights = _average_heights(points, path, corner, (rows, columns))
    steps = measure_ground_steps(heights, CELL)
    basins = _flood(heights, steps.heights)
    if not basins.any():
        return GroundPieces(corner, basins)
    names, borders = join_level(measure_borders(basins, steps.rises), int(basins.max()) + 1)
    pieces = names[basins]
    names, meetings = join_level(measure_gaps(pieces, heights, CELL, borders) | borders, len(names))
    return GroundPieces(corner, _number(names[pieces], meetings))


def _average_heights(
    points: Float32[ndarray, "n 3"],
    path: Float64[ndarray, "s 3"],
    corner: Float64[ndarray, "2"],
    shape: tuple[int, int],
) -> Float64[ndarray, "x y"]:
    """Average the heights of points in each cell near the path; NaN where there are none."""
    cells = np.floor((points[:, :2] - corner) / CELL).astype(np.int64)
    inside = ((cells >= 0) & (cells < shape)).all(axis=1)
    cell = cells[inside, 0] * shape[1] + cells[inside, 1]
    counts = np.bincount(cell, minlength=shape[0] * shape[1])
    sums = np.bincount(cell, points[inside, 2].astype(float), minlength=len(counts))
    known = np.flatnonzero(counts)
    places = (np.column_stack(np.divmod(known, shape[1])) + 0.5) * CELL + corner
    known = known[KDTree(path[:, :2]).query(places)[0] <= FARTHEST]
    heights = np.full(len(counts), np.nan)
    heights[known] = sums[known] / counts[known]
    return heights.reshape(shape)


def _flood(heights: Float64[ndarray, "x y"], steps: Float64[ndarray, "x y"]) -> Int64[ndarray, "x y"]:
    """Number the basins between steps from 1; 0 where no ground is known."""
    block = np.ones((3, 3), bool)
    measured = np.isfinite(heights)
    known = measured | np.asarray(ndimage.binary_closing(measured, block), bool)
    ridges = np.nan_to_num(steps)
    level = np.asarray(ndimage.binary_erosion(known & (ridges < LEVEL), block), bool)
    inner = np.asarray(ndimage.distance_transform_edt(level)) * CELL >= PASSAGE / 2
    is_open = level & (np.asarray(ndimage.distance_transform_edt(~inner)) * CELL < PASSAGE / 2)
    markers = np.asarray(label(inner, connectivity=1), np.int64)
    narrow = np.asarray(label(level & ~is_open, connectivity=1), np.int64)
    markers = np.where(narrow > 0, narrow + markers.max(), markers)
    markers[(np.bincount(markers.ravel()) * CELL**2 < LEAST_BASIN)[markers]] = 0
    return np.asarray(watershed(ridges, markers, mask=known), np.int64)


def _number(pieces: Int64[ndarray, "x y"], meetings: Meetings) -> Int64[ndarray, "x y"]:
    """Number the pieces that stand alone from 0, by size; other cells get the number of the nearest that has one."""
    numbers = _select_apart(np.bincount(pieces.ravel()) * CELL**2, meetings)[pieces]
    nearest = ndimage.distance_transform_edt(numbers < 0, return_distances=False, return_indices=True)
    return numbers[tuple(np.asarray(nearest))]


def _select_apart(areas: Float64[ndarray, " c"], meetings: Meetings) -> Int64[ndarray, " c"]:
    """Number the largest piece and those that meet larger ones across enough of a kerb. Others get the number of the
    one that they differ least from, or -1 where they meet none."""
    around: dict[int, dict[int, Meeting]] = defaultdict(dict)
    for (low, high), meeting in meetings.items():
        around[low][high] = around[high][low] = meeting
    numbers = np.full(len(areas), -1)
    for piece in np.argsort(-areas[1:], kind="stable") + 1:
        larger = {other: meeting for other, meeting in around[piece].items() if numbers[other] >= 0}
        kerb = sum(len(meeting.rises) for meeting in larger.values()) * CELL
        is_parted = areas[piece] >= LEAST_AREA and kerb >= LEAST_KERB * math.sqrt(areas[piece])
        if is_parted or numbers.max() < 0:
            numbers[piece] = numbers.max() + 1
        elif larger:
            numbers[piece] = numbers[max(larger, key=lambda other: larger[other].attraction)]
    return numbers
