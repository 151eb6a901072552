"""Whether the corner of each path stands or moves: no standing point explains it, or photos look through its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int8, Int32
from numpy import ndarray

from instdrive_core.scene.camera import Camera
from instdrive_core.tracks.photos.feature_paths import FeaturePaths, measure_speeds
from instdrive_core.tracks.photos.looking_through import ShownCorners, find_looked_through
from instdrive_core.tracks.photos.standing_ground import find_least_inverse_depths, measure_camera_height
from instdrive_core.tracks.photos.static_fit import StaticFit, fit_standing_points

SHORTEST = 3
"""Photos of a path that says something."""
FLOOR = 1.0
"""Pixels by which a standing corner may always be off."""
TIMES_USUAL = 3.0
"""Times the usual error of paths as quick, above which a corner moves."""
_SURE = 0.1
"""Relative error of a depth that is known well, for an error of one pixel."""
_GROUND_SLACK, _GROUND_REACH = 0.5, 30.0
_SILENT_BEYOND = 60.0
"""Metres; what follows the camera's own way looks as if it stood far away, so that nothing is said there."""
_BINS = 8
_HIGHEST_BIN = 2.5
"""Times the usual error of all paths that that of the quickest may be: near movers are among them."""


@dataclass(frozen=True)
class CameraPaths:
    """Paths through the photos of one camera."""

    cameras: Sequence[Camera]
    """Camera of each photo."""
    paths: FeaturePaths


def judge_paths(rig: Sequence[CameraPaths]) -> list[Int8[ndarray, " n"]]:
    """Judge each path of each camera: 1 = moves, -1 = stands, 0 = nothing can be said.

    Args:
        rig: cameras that saw the same place; each may look through what others saw.
    """
    judged = [_judge_by_fit(one) for one in rig]
    known = np.concatenate([fit.points[sure] for fit, _, sure in judged]) if judged else np.zeros((0, 3))
    judged = [_keep_above_ground(one, *found, known) for one, found in zip(rig, judged, strict=True)]
    shown = [_list_standing(one, fit, stands) for one, (fit, stands, _) in zip(rig, judged, strict=True)]
    verdicts = []
    for number, (one, (fit, stands, sure)) in enumerate(zip(rig, judged, strict=True)):
        moves = ~stands
        rows = np.flatnonzero(sure)
        moves[rows] = _are_looked_through(fit.points[rows], _find_spans(one.paths)[rows], number, rig, shown)
        says = (one.paths.lengths >= SHORTEST) & (moves | (fit.inverse_depths > 1 / _SILENT_BEYOND))
        verdicts.append(np.where(says, np.where(moves, 1, -1), 0).astype(np.int8))
    return verdicts


Fitted = tuple[StaticFit, Bool[ndarray, " n"], Bool[ndarray, " n"]]
"""Standing points, which paths they explain, and of which of these the depth is known well."""


def _judge_by_fit(one: CameraPaths) -> Fitted:
    fit = fit_standing_points(one.paths, one.cameras)
    return fit, *_compare(one, fit, fit)


def _compare(one: CameraPaths, fit: StaticFit, free: StaticFit) -> tuple[Bool[ndarray, " n"], Bool[ndarray, " n"]]:
    says = one.paths.lengths >= SHORTEST
    stands = says & (fit.residuals <= _find_tolerances(one, free, says))
    return stands, stands & (fit.deviations < _SURE * fit.inverse_depths)


def _find_tolerances(one: CameraPaths, fit: StaticFit, says: Bool[ndarray, " n"]) -> Float64[ndarray, " n"]:
    """Pixels that each path may be off: three times the usual error of paths as quick."""
    if not says.any():
        return np.full(len(one.paths), FLOOR)
    speeds, errors = measure_speeds(one.paths), fit.residuals
    edges = np.quantile(speeds[says], np.linspace(0, 1, _BINS + 1))
    bins = np.clip(np.searchsorted(edges, speeds) - 1, 0, _BINS - 1)
    overall = float(np.median(errors[says]))
    usual = [np.median(errors[says & (bins == k)]) if (says & (bins == k)).any() else overall for k in range(_BINS)]
    by_speed = np.interp(speeds, (edges[1:] + edges[:-1]) / 2, np.minimum(usual, _HIGHEST_BIN * overall))
    return np.maximum(FLOOR, TIMES_USUAL * by_speed)


def _keep_above_ground(
    one: CameraPaths,
    fit: StaticFit,
    stands: Bool[ndarray, " n"],
    sure: Bool[ndarray, " n"],
    known: Float64[ndarray, "m 3"],
) -> Fitted:
    """Fit again, with no point below the ground: what drives ahead at our speed seems to be far below it."""
    positions = np.stack([camera.position for camera in one.cameras])
    height = measure_camera_height(positions, known) if len(known) else None
    if height is None:
        return fit, stands, sure
    least = find_least_inverse_depths(fit.rays, fit.origins, height, _GROUND_SLACK, _GROUND_REACH)
    above = fit_standing_points(one.paths, one.cameras, least)
    return above, *_compare(one, above, fit)


def _list_standing(one: CameraPaths, fit: StaticFit, stands: Bool[ndarray, " n"]) -> list[ShownCorners]:
    owners, shown = one.paths.owners, []
    likely = fit.inverse_depths
    share = likely / np.maximum(likely + 2 * fit.deviations, 1e-9)
    for number, camera in enumerate(one.cameras):
        entries = np.flatnonzero((one.paths.photos == number) & stands[owners])
        rows = owners[entries]
        depths = camera.project(fit.points[rows])[1]
        places = one.paths.places[entries].astype(np.float64)
        shown.append(ShownCorners(camera, places, depths * share[rows], depths))
    return shown


def _find_spans(paths: FeaturePaths) -> Int32[ndarray, "n 2"]:
    """First and last photo of each path, (n, 2)."""
    return np.stack([paths.photos[paths.starts[:-1]], paths.photos[paths.starts[1:] - 1]], axis=1)


def _are_looked_through(
    points: Float64[ndarray, "n 3"],
    spans: Int32[ndarray, "n 2"],
    number: int,
    rig: Sequence[CameraPaths],
    shown: Sequence[Sequence[ShownCorners]],
) -> Bool[ndarray, " n"]:
    """Which points of the camera `number`, measured in their spans of its photos, photos look through."""
    own = [
        (spans[:, 0] <= photo) & (photo <= spans[:, 1]) if camera == number else np.zeros(len(points), bool)
        for camera, one in enumerate(rig)
        for photo in range(len(one.cameras))
    ]
    return find_looked_through(points, np.stack(own), [photo for of_camera in shown for photo in of_camera])
