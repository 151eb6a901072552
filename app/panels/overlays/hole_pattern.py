"""The pattern that shows a hole in the ground: stripes, hatching and outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.holes.holes import Hole
from instdrive_core.scene.camera import Camera

NEAREST = 0.1
"""Distance from the camera, in metres, within which nothing is drawn."""
HATCH_CELLS = 2
"""Cells between two lines of the hatching."""
STRIPE_CELLS = 5
"""Cells in a stripe at most: short stripes, because one that reaches behind the camera is left out."""

Pixels = list[list[list[float]]]
"""Corners of shapes: x and y in pixels of the picture."""


@dataclass(frozen=True)
class HolePattern:
    """Shapes on the ground, in the world's metres."""

    stripes: Float64[ndarray, "q 4 3"]
    """Quadrilaterals that cover the hole together."""
    hatching: Float64[ndarray, "h 2 3"]
    outline: Float64[ndarray, "o 2 3"]

    def project(self, camera: Camera) -> tuple[Pixels, Pixels, Pixels]:
        """Project stripes, hatching and outline into a camera's picture."""
        return (
            project_shapes(self.stripes, camera),
            project_shapes(self.hatching, camera),
            project_shapes(self.outline, camera),
        )


def build_hole_pattern(hole: Hole) -> HolePattern:
    """Build the pattern of all cells that a fill would cover: those never seen, and the shadow."""
    cells = np.concatenate([hole.cells, hole.shadow])
    low = cells.min(axis=0) - 1
    filled = np.zeros(cells.max(axis=0) - low + 2, bool)
    filled[tuple((cells - low).T)] = True

    def place(corners: Int64[ndarray, "k c 2"]) -> Float64[ndarray, "k c 3"]:
        flat = (corners + low).reshape(-1, 2)
        places = np.array(hole.grid.corner) + hole.grid.size * flat @ hole.grid.axes
        return hole.grid.lift_to_ground(places).reshape(*corners.shape[:2], 3)

    return HolePattern(place(_build_stripes(filled)), place(_build_hatching(filled)), place(_build_outline(filled)))


def project_shapes(shapes: Float64[ndarray, "k c 3"], camera: Camera) -> Pixels:
    """Project shapes into a camera's picture; those not wholly in front of the camera are left out."""
    pixels, depths = camera.project(shapes.reshape(-1, 3))
    before = (depths > NEAREST).reshape(shapes.shape[:2]).all(axis=1)
    return pixels.reshape(*shapes.shape[:2], 2)[before].tolist()


def _build_stripes(filled: Bool[ndarray, "a b"]) -> Int64[ndarray, "q 4 2"]:
    """Corners of runs of cells along axis 0."""
    quads = []
    for across in np.flatnonzero(filled.any(axis=0)).tolist():
        edges = np.diff(filled[:, across].astype(np.int8), prepend=0, append=0)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            for first in range(start, end, STRIPE_CELLS):
                last = min(first + STRIPE_CELLS, end)
                quads.append([[first, across], [last, across], [last, across + 1], [first, across + 1]])
    return np.array(quads, np.int64).reshape(-1, 4, 2)


def _build_hatching(filled: Bool[ndarray, "a b"]) -> Int64[ndarray, "h 2 2"]:
    """One diagonal for each cell of every other diagonal row; together they form long lines."""
    cells = np.argwhere(filled)
    cells = cells[(cells[:, 0] - cells[:, 1]) % HATCH_CELLS == 0]
    return np.stack([cells, cells + 1], axis=1)


def _build_outline(filled: Bool[ndarray, "a b"]) -> Int64[ndarray, "o 2 2"]:
    """Edges between the hole's cells and others."""
    step_along, step_across = np.eye(2, dtype=np.int64)
    along = np.argwhere(filled[:, 1:] != filled[:, :-1]) + step_across
    across = np.argwhere(filled[1:] != filled[:-1]) + step_along
    sides = [np.stack([along, along + step_along], axis=1), np.stack([across, across + step_across], axis=1)]
    return np.concatenate(sides)
