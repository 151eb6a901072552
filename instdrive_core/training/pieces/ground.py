"""Which piece a place belongs to: the one whose own stretch of the drive comes nearest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.scene.scene import Scene
from instdrive_core.training.pieces.plan import DriveStep, Piece


class Territories:
    """Pieces by place. The border of two is the plane half-way between the cameras of two time steps."""

    def __init__(self, steps: Sequence[DriveStep], pieces: Sequence[Piece]) -> None:
        self._owners = np.array([_find_owner(step.index, pieces) for step in steps], np.int64)
        self._tree = KDTree(np.array([step.place for step in steps]))

    def find_owners(self, places: Float[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
        """Find the number of the piece that each place (metres) belongs to; the first for what is not finite."""
        finite = np.isfinite(places).all(axis=1)
        owners = np.zeros(len(places), np.int64)
        owners[finite] = self._owners[self._tree.query(places[finite])[1]]
        return owners

    def choose_background(self, scene: Scene, piece: int) -> Bool[ndarray, " n"]:
        """Choose the Gaussians of a piece's background that lie in its own territory."""
        rows = np.flatnonzero(scene.nodes == 0)
        chosen = np.zeros(len(scene), bool)
        chosen[rows] = self.find_owners(scene.gaussians.means[rows].astype(np.float64)) == piece
        return chosen


def list_owned_steps(piece: Piece) -> range:
    """List the time steps that belong to a piece alone."""
    return range(piece.core_first, piece.core_last + 1)


def measure_closeness(scene: Scene, actor: int) -> float:
    """Measure how well the training photos of a scene saw an actor: the sum of 1 / distance² (metres) over those whose
    picture holds the middle of its box."""
    track, total = scene.actors[actor], 0.0
    for view in scene.views:
        if view.held_out or not track.covers(view.time):
            continue
        place = track.interpolate_pose(view.time)[:3, 3]
        pixels, depths = view.camera.project(place[None])
        inside = (pixels[0] > 0).all() and pixels[0, 0] < view.camera.width and pixels[0, 1] < view.camera.height
        if depths[0] > 0 and inside:
            total += 1 / max(1.0, float(depths[0])) ** 2
    return total


def _find_owner(index: int, pieces: Sequence[Piece]) -> int:
    return next(number for number, piece in enumerate(pieces) if piece.core_first <= index <= piece.core_last)
