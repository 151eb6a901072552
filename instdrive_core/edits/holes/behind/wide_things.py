"""What a thing hid that is too wide for a hole of its own in the ground, such as a hedge, a fence or a row of trees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.holes import Hole, build_ground_grid
from instdrive_core.edits.holes.photo_evidence import Look
from instdrive_core.edits.holes.surroundings import Surroundings, find_lane_here, find_neighborhood
from instdrive_core.edits.queries.compact_objects import select_solid_points

FOOT = 0.3
"""Metres above the lowest splats of a thing near which the ground around is looked for."""


def find_hole_behind(
    document: Document,
    things: Sequence[tuple[int, Int64[ndarray, "_"]]],
    looks: Sequence[Look],
    time: float,
    leaving: Int64[ndarray, "_"],
) -> Hole | None:
    """The hole, without any ground, that wide things left which are deleted; None where no ground is found around.

    Args:
        document: they may be deleted in it already.
        things: instances and their rows.
        looks: the photos that show them, the one that shows most first.
        time: seconds.
        leaving: rows that are deleted with them.
    """
    rows = np.concatenate([each for _, each in things])
    points = select_solid_points(document, rows)
    middle: Float64[ndarray, "3"] = np.median(points, axis=0)
    middle[2] = np.quantile(points[:, 2], 0.02) + FOOT
    for place in (middle, *(look.camera.position for look in looks)):
        grid = _lay_grid(document, place, np.concatenate([rows, leaving]), time)
        if grid is not None:
            none = np.zeros((0, 2), np.int64)
            return Hole(grid, none, none, behind=tuple(number for number, _ in things))
    return None


def _lay_grid(
    document: Document, place: Float64[ndarray, "3"], gone: Int64[ndarray, " g"], time: float
) -> GroundGrid | None:
    near = find_neighborhood(document, place, gone)
    along = find_lane_here(document, place, time)
    return build_ground_grid(Surroundings(place, along, near, (), (), (), document.scene.views))
