"""Range images: what a LiDAR met in each direction, and how many of them saw through a place or met something there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt16
from numba import njit, prange
from numpy import ndarray

AZIMUTHS = 1200
"""Pixels around: 0.3° each."""
LOWEST, HIGHEST = -36.0, 24.0
"""Elevations in degrees that range images cover."""
HEIGHTS_OF_PIXELS = (0.3, 0.5, 0.75, 1.0, 1.5, 2.0)
"""Degrees: the least of these at which the beams of a LiDAR leave few rows of its image empty is used."""
DENSE = 0.5
"""Share of measured pixels above and below measured ones from which on an image is dense."""
NOTHING = 65535
"""Value of a pixel in which no beam met anything; others are centimetres."""
FARTHER, FARTHER_SHARE = 0.5, 0.02
"""Metres, and share of its distance, by which all beams around must go on behind a point to have seen through it."""
SAME = 0.3
"""Metres of range within which another LiDAR image met something at the place of a point."""
WINDOW = 1.5
"""Seconds within which what was met at a place counts as standing there: queues creep on."""
CELL = 0.15
"""Metres: points of one sweep in one cell of this size share their votes."""
SURE, SURE_VOTES = 0.5, 6
"""Share of the images asked, and their number, that must have met something where nothing moves."""
MAX_IMAGES = 120
"""Images that vote on a sweep, the nearest in time first in full, those farther away thinned out."""


@dataclass(frozen=True)
class SweepImage:
    """What one LiDAR met in each direction during a sweep."""

    position: Float64[ndarray, "3"]
    """Rough place of the sensor."""
    ranges: UInt16[ndarray, "elevations azimuths"]
    """Centimetres to the nearest point of each pixel, `NOTHING` where there is none."""


@dataclass(frozen=True)
class Votes:
    """How other sweeps saw the places of one sweep's points."""

    free: Int32[ndarray, " n"]
    """Images that saw through the place."""
    occupied: Int32[ndarray, " n"]
    """Images within `WINDOW` seconds that met something there."""
    near_images: int
    """Images within `WINDOW` seconds."""

    @property
    def is_static(self) -> ndarray:
        """Whether each point surely stands still: often met by others, seldom seen through."""
        return (self.occupied > 0.2 * self.near_images) & (2 * self.free < self.occupied)

    @property
    def is_seen_through(self) -> ndarray:
        """Whether something was at the place of each point for a while only."""
        return (self.free >= 2) & (self.free > self.occupied / 4)


def build_sweep_image(points: Float32[ndarray, "n 3"], position: Float64[ndarray, "3"]) -> SweepImage:
    """The range image of one LiDAR's points, its pixels as high as its beams are apart."""
    points = np.ascontiguousarray(points, np.float32)
    ranges = np.zeros((0, AZIMUTHS), np.uint16)
    for height in HEIGHTS_OF_PIXELS:
        ranges = _draw(points, position, round((HIGHEST - LOWEST) / height))
        measured = ranges != NOTHING
        beside = measured[:-2] | measured[2:]
        if not beside.any() or (measured[1:-1] & beside).sum() > DENSE * beside.sum():
            break
    return SweepImage(position, ranges)


@njit(cache=True)
def _draw(points: ndarray, position: ndarray, rows: int) -> ndarray:
    ranges = np.full((rows, 1200), NOTHING, np.uint16)
    scale = rows / (HIGHEST - LOWEST)
    for number in range(len(points)):
        x = points[number, 0] - position[0]
        y = points[number, 1] - position[1]
        z = points[number, 2] - position[2]
        distance = np.sqrt(x * x + y * y + z * z)
        if distance < 0.5 or distance > 650.0:
            continue
        row = int((np.degrees(np.arcsin(z / distance)) - LOWEST) * scale)
        column = int((np.arctan2(y, x) / (2 * np.pi) + 0.5) * 1200) % 1200
        if 0 <= row < rows:
            ranges[row, column] = min(ranges[row, column], np.uint16(distance * 100))
    return ranges


@njit(cache=True, fastmath=True)
def _find_turn(y: np.float32, x: np.float32) -> np.float32:
    """arctan2 to 1e-4 radians, quicker (Hastings, Approximations for Digital Computers, 1955)."""
    across, along = abs(y), abs(x)
    ratio = min(across, along) / max(across, along, np.float32(1e-9))
    square = ratio * ratio
    angle = ((np.float32(-0.0464964749) * square + np.float32(0.15931422)) * square - np.float32(0.327622764)) * square
    angle = angle * ratio + ratio
    if across > along:
        angle = np.float32(np.pi / 2) - angle
    if x < 0:
        angle = np.float32(np.pi) - angle
    return -angle if y < 0 else angle


@njit(cache=True, parallel=True, fastmath=True)
def _vote(points: ndarray, position: ndarray, ranges: ndarray, is_near: bool, free: ndarray, occupied: ndarray) -> None:
    """Count, for each point, whether one image met something at its place or saw through it."""
    rows, columns = ranges.shape
    scale, lowest = np.float32(rows / (HIGHEST - LOWEST) * 180 / np.pi), np.float32(LOWEST * np.pi / 180)
    around, half = np.float32(columns / (2 * np.pi)), np.float32(columns / 2)
    for number in prange(len(points)):
        x = np.float32(points[number, 0] - position[0])
        y = np.float32(points[number, 1] - position[1])
        z = np.float32(points[number, 2] - position[2])
        flat = np.sqrt(x * x + y * y)
        distance = np.int32(np.sqrt(flat * flat + z * z) * 100)
        row = np.int32((_find_turn(z, flat) - lowest) * scale)
        if row < 1 or row >= rows - 1 or distance > 64000:
            continue
        column = np.int32(_find_turn(y, x) * around + half)
        if column < 0 or column >= columns:
            column = np.int32(0)
        least, meets = np.int32(NOTHING), False
        for above in range(row - 1, row + 2):
            for side in range(columns - 1, columns + 2):
                beside = column + side - columns
                if beside < 0:
                    beside += columns
                elif beside >= columns:
                    beside -= columns
                found = np.int32(ranges[above, beside])
                least = min(least, found)
                meets |= abs(found - distance) < SAME * 100
        if meets and is_near:
            occupied[number] += 1
        if ranges[row, column] != NOTHING and least > distance * (1 + FARTHER_SHARE) + FARTHER * 100:
            free[number] += 1


def count_votes(
    points: list[Float32[ndarray, "n 3"]], times: Float64[ndarray, " s"], images: list[tuple[SweepImage, ...]]
) -> list[Votes]:
    """How all other sweeps saw the points of each sweep.

    Args:
        points: of each sweep, in the world, metres.
        times: of each sweep, seconds, rising.
        images: of each sweep.
    """
    votes = []
    for number, every in enumerate(points):
        chosen, group = group_points(every)
        voters = [
            (image, bool(abs(times[other] - times[number]) <= WINDOW))
            for other in _voters(number, times, len(images[number]))
            for image in images[other]
        ]
        voters = voters[::3] + voters[1::3] + voters[2::3]
        free, occupied = np.zeros(len(chosen), np.int32), np.zeros(len(chosen), np.int32)
        left = np.arange(len(chosen))
        asked = 0
        for start, end in ((0, len(voters) // 3), (len(voters) // 3, len(voters))):
            own, own_free, own_occupied = every[chosen[left]], free[left], occupied[left]
            for image, is_near in voters[start:end]:
                _vote(own, image.position, image.ranges, is_near, own_free, own_occupied)
                asked += is_near
            free[left], occupied[left] = own_free, own_occupied
            # What so many met and none saw through stands; the others need not be asked.
            sure = (own_occupied >= max(SURE_VOTES, SURE * asked)) & (own_free == 0)
            if end < len(voters):
                occupied[left[sure]] *= 3
            left = left[~sure]
        near_images = sum(is_near for _, is_near in voters)
        votes.append(Votes(free[group], occupied[group], near_images))
    return votes


def group_points(points: Float32[ndarray, "n 3"]) -> tuple[ndarray, ndarray]:
    """Rows of one point per cell of `CELL` metres, and for each point the number of the one in its cell."""
    cells = np.floor(points / CELL).astype(np.int64)
    cells -= cells.min(axis=0, initial=0) if len(cells) else 0
    sizes = cells.max(axis=0, initial=0) + 1
    keys = (cells[:, 0] * sizes[1] + cells[:, 1]) * sizes[2] + cells[:, 2]
    _, chosen, group = np.unique(keys, return_index=True, return_inverse=True)
    return chosen, group


def _voters(number: int, times: Float64[ndarray, " s"], images_each: int) -> list[int]:
    """Sweeps that vote on one: all near ones, and so many of the far ones that `MAX_IMAGES` are not exceeded."""
    others = [other for other in range(len(times)) if other != number]
    near = [other for other in others if abs(times[other] - times[number]) <= WINDOW]
    far = [other for other in others if abs(times[other] - times[number]) > WINDOW]
    room = max(4, MAX_IMAGES // max(1, images_each) - len(near))
    return near + far[:: max(1, -(-len(far) // room))]
