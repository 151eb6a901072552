"""Corners of photos, followed from photo to photo of one camera (Lucas-Kanade, forwards and backwards)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt8
from numpy import ndarray

MOST_CORNERS = 3000
"""Corners followed at a time."""
SPACING = 4
"""Pixels between corners."""
_QUALITY = 0.001
"""Share of the strongest corner's strength that a corner needs: smooth car bodies have weak ones only."""
_WINDOW, _LEVELS = 13, 4
_LARGEST_LOOP = 0.7
"""Pixels by which following there and back may miss the start."""
_DARKEST_DIFFERENCE = 25.0
"""Mean difference of grey values, of 255, above which a patch is another one."""

_Path = list[tuple[int, float, float]]
"""Photo, column and row of a corner, photo after photo."""


@dataclass(frozen=True)
class FeaturePaths:
    """Paths of corners, those of one path one after the other."""

    starts: Int64[ndarray, " b"]
    """Where each path begins in `photos` and `places`; last their length."""
    photos: Int32[ndarray, " k"]
    """Number of the photo, rising by one along a path."""
    places: Float32[ndarray, "k 2"]
    """Column and row in pixels; the first pixel's centre lies at 0.5."""

    def __len__(self) -> int:
        return len(self.starts) - 1

    @property
    def lengths(self) -> Int64[ndarray, " n"]:
        """Photos of each path."""
        return np.diff(self.starts)

    @property
    def owners(self) -> Int64[ndarray, " k"]:
        """The path of each place."""
        return np.repeat(np.arange(len(self)), self.lengths)


def follow_corners(photos: Iterable[tuple[UInt8[ndarray, "h w"], Bool[ndarray, "h w"]]]) -> FeaturePaths:
    """Follow corners through the photos of one camera, in order of time.

    Args:
        photos: grey photo, and where corners may be.
    """
    alive: list[_Path] = []
    done: list[_Path] = []
    before: UInt8[ndarray, "h w"] | None = None
    for number, (photo, usable) in enumerate(photos):
        if before is not None and alive:
            places = np.array([path[-1][1:] for path in alive], np.float32)
            moved, kept = _follow(before, photo, places, usable)
            done += [path for path, is_kept in zip(alive, kept, strict=True) if not is_kept]
            for path, place in zip(alive, moved.tolist(), strict=True):
                path.append((number, place[0], place[1]))
            for path, is_kept in zip(alive, kept, strict=True):
                if not is_kept:
                    path.pop()
            alive = [path for path, is_kept in zip(alive, kept, strict=True) if is_kept]
            alive, crowded = _thin(alive, photo.shape)
            done += crowded
        taken = np.array([path[-1][1:] for path in alive], np.float32).reshape(-1, 2)
        alive += [[(number, x, y)] for x, y in _find_corners(photo, usable, taken).tolist()]
        before = photo
    return _pack([path for path in (*done, *alive) if len(path) > 1])


def _thin(paths: list[_Path], shape: tuple[int, ...]) -> tuple[list[_Path], list[_Path]]:
    """Paths that keep apart, the longest first, and those that ran into them."""
    taken = np.zeros((shape[0] // 3 + 1, shape[1] // 3 + 1), bool)
    kept: list[_Path] = []
    crowded: list[_Path] = []
    for path in sorted(paths, key=len, reverse=True):
        cell = int(path[-1][2]) // 3, int(path[-1][1]) // 3
        (crowded if taken[cell] else kept).append(path)
        taken[cell] = True
    return kept, crowded


def _follow(
    before: UInt8[ndarray, "h w"],
    photo: UInt8[ndarray, "h w"],
    places: Float32[ndarray, "n 2"],
    usable: Bool[ndarray, "h w"],
) -> tuple[Float32[ndarray, "n 2"], Bool[ndarray, " n"]]:
    """Where corners are in the next photo, and which were found again."""
    import cv2

    window = (_WINDOW, _WINDOW)
    centers = (places - 0.5).reshape(-1, 1, 2)
    moved, found, error = cv2.calcOpticalFlowPyrLK(
        before, photo, centers, centers.copy(), winSize=window, maxLevel=_LEVELS
    )
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(photo, before, moved, moved.copy(), winSize=window, maxLevel=_LEVELS)
    loop = np.linalg.norm(back - centers, axis=2).ravel()
    moved = moved.reshape(-1, 2) + np.float32(0.5)
    height, width = photo.shape
    inside = (moved >= 1).all(axis=1) & (moved[:, 0] < width - 1) & (moved[:, 1] < height - 1)
    kept = inside & found.ravel().astype(bool) & found_back.ravel().astype(bool) & (loop < _LARGEST_LOOP)
    kept &= error.ravel() < _DARKEST_DIFFERENCE
    columns, rows = np.where(kept[:, None], moved, 0).astype(int).T
    return moved.astype(np.float32), kept & usable[rows, columns]


def _find_corners(
    photo: UInt8[ndarray, "h w"], usable: Bool[ndarray, "h w"], taken: Float32[ndarray, "n 2"]
) -> Float32[ndarray, "m 2"]:
    """New corners, apart from those that are followed already."""
    import cv2

    wanted = MOST_CORNERS - len(taken)
    free = usable.astype(np.uint8)
    for column, row in taken.astype(int).tolist():
        free[max(row - SPACING, 0) : row + SPACING + 1, max(column - SPACING, 0) : column + SPACING + 1] = 0
    if wanted <= 0 or not free.any():
        return np.zeros((0, 2), np.float32)
    corners = cv2.goodFeaturesToTrack(photo, wanted, _QUALITY, SPACING, mask=free, blockSize=5)
    return np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2) + np.float32(0.5)


def _pack(paths: list[_Path]) -> FeaturePaths:
    entries = np.array([entry for path in paths for entry in path], np.float64).reshape(-1, 3)
    starts = np.concatenate([[0], np.cumsum([len(path) for path in paths])]).astype(np.int64)
    return FeaturePaths(starts, entries[:, 0].astype(np.int32), entries[:, 1:].astype(np.float32))


def drop_last_places(paths: FeaturePaths) -> FeaturePaths:
    """Drop the last place of paths of four and more: many end where the corner slid off."""
    lengths = paths.lengths
    shortened = lengths >= 4
    kept = np.ones(len(paths.photos), bool)
    kept[paths.starts[1:][shortened] - 1] = False
    starts = np.concatenate([[0], np.cumsum(lengths - shortened)]).astype(np.int64)
    return FeaturePaths(starts, paths.photos[kept], paths.places[kept])


def measure_speeds(paths: FeaturePaths) -> Float64[ndarray, " n"]:
    """Measure how far each corner goes from photo to photo, on average; pixels."""
    steps = np.zeros(len(paths.photos))
    steps[1:] = np.linalg.norm(np.diff(paths.places, axis=0), axis=1)
    steps[paths.starts[:-1]] = 0
    return np.bincount(paths.owners, steps, len(paths)) / np.maximum(paths.lengths - 1, 1)
