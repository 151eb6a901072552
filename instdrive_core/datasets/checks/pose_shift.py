"""Whether photos fit the poses of their neighbours better than their own: edges in depth against edges in the photo.

Where a LiDAR point stands before what lies behind it, the photo mostly has an edge. With the poses of another time
step these borders move across the photo, by a dozen pixels where the car drives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.scene.camera import Camera

SHIFTS = (-1, 0, 1)
"""Time steps between a photo and the pose that is tried for it."""
MOST_STEPS = 8
"""Time steps looked at, spread over the drive."""
LEAST_WAY = 0.25
"""Metres between neighbouring poses, below which they are too alike to be told apart."""
LEAST_PHOTOS = 6
"""Photos needed for a verdict."""
ALL_GAIN, CAMERA_GAIN = 0.02, 0.04
"""Share by which another step's poses must fit better than the photos' own: those of all cameras, those of one.

Measured with right poses: -5 % or less of all cameras, at most 2.5 % of one; with wrong ones 4 to 24 %."""
ALL_AGREEMENT, CAMERA_AGREEMENT = 0.7, 0.85
"""Share of the photos that must say so."""
_CELLS_ACROSS = 120
_NEAREST, _FARTHEST = 2.0, 40.0
_BEFORE, _BEFORE_SHARE = 0.5, 1.3
"""A border: what lies beside it is farther by so many metres and by this factor."""
_LEAST_BORDER = 40
"""Cells of a border in a photo."""


@dataclass(frozen=True)
class PoseShift:
    """Poses that fit the photos of other time steps."""

    camera: str | None
    """Whose poses; None = those of all cameras."""
    steps: int
    """A photo of step i fits the pose of step i + `steps`."""
    photos: int
    """Photos looked at."""
    agreement: float
    """Share of them that fit it better than their own."""


def find_pose_shifts(clip: Clip) -> list[PoseShift]:
    """Find cameras whose poses are off by one time step; one entry for all where all are off alike.

    Needs LiDAR and a car that drives. Raises DataError where a photo or sweep is damaged.
    """
    scores = _score_photos(clip)
    everything = [row for rows in scores.values() for row in rows]
    shift = _judge(None, everything)
    if shift is not None:
        return [shift]
    return [found for name, rows in scores.items() if (found := _judge(name, rows)) is not None]


def _judge(camera: str | None, rows: Sequence[Float64[ndarray, "3"]]) -> PoseShift | None:
    if len(rows) < LEAST_PHOTOS:
        return None
    scores = np.stack(rows)
    least_gain, least_agreement = (ALL_GAIN, ALL_AGREEMENT) if camera is None else (CAMERA_GAIN, CAMERA_AGREEMENT)
    for column in (0, 2):
        agreement = float((scores[:, column] > scores[:, 1]).mean())
        gain = scores[:, column].mean() / scores[:, 1].mean() - 1
        if agreement >= least_agreement and gain >= least_gain:
            return PoseShift(camera, SHIFTS[column], len(rows), agreement)
    return None


def _score_photos(clip: Clip) -> dict[str, list[Float64[ndarray, "3"]]]:
    """How well each chosen photo's edges fit the depth borders seen from the poses of SHIFTS, by camera."""
    frames = {(frame.view.name, frame.view.index): frame for frame in clip.frames}
    sweeps = {sweep.index: sweep for sweep in clip.sweeps}
    usable = [index for index in sorted(sweeps) if _list_neighbours(frames, clip.camera_names, index)]
    chosen = np.unique(np.linspace(0, len(usable) - 1, min(len(usable), MOST_STEPS)).round().astype(int))
    scores: dict[str, list[Float64[ndarray, "3"]]] = {name: [] for name in clip.camera_names}
    for index in (usable[place] for place in chosen):
        points = sweeps[index].load().points
        for frame, cameras in _list_neighbours(frames, clip.camera_names, index):
            edges = _find_edges(frame)
            row = [_measure_fit(edges, points, camera) for camera in cameras]
            if all(value > 0 for value in row):
                scores[frame.view.name].append(np.array(row))
    return scores


def _list_neighbours(
    frames: dict[tuple[str, int], Frame], names: Sequence[str], index: int
) -> list[tuple[Frame, list[Camera]]]:
    """Photos of a step whose neighbours in time have poses far enough away, with the poses of SHIFTS."""
    found = []
    for name in names:
        near = [frames.get((name, index + shift)) for shift in SHIFTS]
        cameras = [frame.view.camera for frame in near if frame is not None]
        if len(cameras) < len(SHIFTS) or near[1] is None:
            continue
        ways = [np.linalg.norm(camera.position - cameras[1].position) for camera in (cameras[0], cameras[2])]
        if min(ways) >= LEAST_WAY:
            found.append((near[1], cameras))
    return found


def _find_edges(frame: Frame) -> Float32[ndarray, "r c"]:
    """Strength of the strongest edge in each cell of a photo, as its rank from 0 to 1."""
    photo: UInt8[ndarray, "h w 3"] = frame.load_image()
    gray = ndimage.gaussian_filter(photo.mean(axis=2, dtype=np.float32), 0.7)
    strength = np.hypot(ndimage.sobel(gray, 0), ndimage.sobel(gray, 1))
    camera = frame.view.camera
    cell = _cell_size(camera)
    rows, columns = camera.height // cell, camera.width // cell
    cells = strength[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell).max(axis=(1, 3))
    order = np.empty(cells.size, np.float32)
    order[np.argsort(cells, axis=None)] = np.linspace(0, 1, cells.size, dtype=np.float32)
    return order.reshape(cells.shape)


def _measure_fit(edges: Float32[ndarray, "r c"], points: Float32[ndarray, "n 3"], camera: Camera) -> float:
    """Mean edge strength on the borders of near things; 0 where there are too few."""
    border = _find_borders(points, camera, (edges.shape[0], edges.shape[1]))
    return float(edges[border].mean()) if border.sum() >= _LEAST_BORDER else 0.0


def _find_borders(points: Float32[ndarray, "n 3"], camera: Camera, shape: tuple[int, int]) -> Bool[ndarray, "r c"]:
    """Cells whose nearest point stands before that of the cell to its left or right."""
    cell = _cell_size(camera)
    small = replace(camera, fx=camera.fx / cell, fy=camera.fy / cell, cx=camera.cx / cell, cy=camera.cy / cell)
    pixels, depth = small.project(points)
    seen = (depth > _NEAREST) & (pixels >= 0).all(axis=1) & (pixels < shape[::-1]).all(axis=1)
    columns, rows = pixels[seen].astype(int).T
    nearest = np.full(shape, np.inf)
    np.minimum.at(nearest, (rows, columns), depth[seen])
    border = np.zeros(shape, bool)
    for side in (-1, 1):
        beside = np.roll(nearest, side, axis=1)
        before = (beside > _BEFORE_SHARE * nearest) & (beside > nearest + _BEFORE) & np.isfinite(beside)
        border |= before & (nearest < _FARTHEST)
    border[:, [0, -1]] = False
    return border


def _cell_size(camera: Camera) -> int:
    return max(1, camera.width // _CELLS_ACROSS)
