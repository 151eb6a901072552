"""Stuff of the annotated cloud in parts: what hangs together in space is one part, wherever photos show it.

Data sets name stuff by class alone: one *building* for both sides of a street. Parts are the smallest pieces that
ground truth tells apart; label maps say which of them belong together (`stuff_regions.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int64, Integer, UInt32
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.masks.annotated.labelled_cloud import UNKNOWN
from instdrive_core.maths.cells import connect_cells

CELL = 1.0
"""Metres: points of one label in neighbouring cells of this size hang together."""
SMALL_PART, SMALL_REACH = 20, 3.0
"""Parts with fewer points join the nearest larger one of their label within so many metres."""
_LARGEST = 1 << 17
"""Cells on either side of the origin along each axis, 131 km, that a key can hold."""


@dataclass(frozen=True)
class StuffParts:
    """Parts of the points that stand still."""

    label_of_part: UInt32[ndarray, " parts"]
    """Label of each part; part 0 has label 0, unknown."""
    parts: UInt32[ndarray, " n"]
    """Part of each point that was split; 0 where its label is unknown."""
    keys: Int64[ndarray, " cells"]
    """Label and place of each cell that holds points, rising."""
    part_of_cell: UInt32[ndarray, " cells"]

    def find_parts(self, points: Float32[ndarray, "p 3"], labels: Integer[ndarray, " p"]) -> UInt32[ndarray, " p"]:
        """Find the part of other points with known labels: that of their cell; 0 where it holds none of the label."""
        if not len(self.keys):
            return np.zeros(len(points), np.uint32)
        wanted = _make_keys(_find_cells(points), labels)
        place = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        return np.where(self.keys[place] == wanted, self.part_of_cell[place], 0).astype(np.uint32)


def split_stuff(points: Float32[ndarray, "n 3"], labels: UInt32[ndarray, " n"]) -> StuffParts:
    """Split labelled points into parts that hang together, numbered from 1 by label; `UNKNOWN` is no part."""
    keys = _make_keys(_find_cells(points), labels)
    cell_keys, first, cell_of_point = np.unique(keys, return_index=True, return_inverse=True)
    cells, cell_labels = _find_cells(points[first]), labels[first]
    part_of_cell = np.zeros(len(cell_keys), np.uint32)
    label_of_part = [UNKNOWN]
    for label in np.unique(cell_labels[cell_labels != UNKNOWN]).tolist():
        inside = cell_labels == label
        part_of_cell[inside] = connect_cells(cells[inside]) + len(label_of_part)
        label_of_part += [label] * (int(part_of_cell.max()) + 1 - len(label_of_part))
    parts = _join_small(points, part_of_cell[cell_of_point], np.array(label_of_part, np.uint32))
    joined = np.zeros(len(label_of_part), np.int64)
    joined[part_of_cell[cell_of_point]] = parts
    kept, numbers = np.unique(joined, return_inverse=True)
    numbers = numbers.astype(np.uint32)
    return StuffParts(
        np.array(label_of_part, np.uint32)[kept],
        numbers[part_of_cell[cell_of_point]],
        cell_keys,
        numbers[part_of_cell],
    )


def _find_cells(points: Float32[ndarray, "n 3"]) -> Int64[ndarray, "n 3"]:
    return np.floor(points / CELL).astype(np.int64)


def _make_keys(cells: Int64[ndarray, "n 3"], labels: Integer[ndarray, " n"]) -> Int64[ndarray, " n"]:
    """One number for label and place. Labels are below 256."""
    x, y, z = (np.clip(cells[:, axis], -_LARGEST, _LARGEST - 1) + _LARGEST for axis in range(3))
    return ((labels.astype(np.int64) * 2 * _LARGEST + x) * 2 * _LARGEST + y) * 2 * _LARGEST + z


def _join_small(
    points: Float32[ndarray, "n 3"], parts: UInt32[ndarray, " n"], label_of_part: UInt32[ndarray, " parts"]
) -> UInt32[ndarray, " n"]:
    """Give small parts near a larger one of their label to it, as a whole: by the nearest pair of points."""
    sizes = np.bincount(parts, minlength=len(label_of_part))
    small = (sizes < SMALL_PART) & (label_of_part != UNKNOWN)
    joined = np.arange(len(label_of_part), dtype=np.uint32)
    for label in np.unique(label_of_part[small]).tolist():
        of_label = label_of_part[parts] == label
        large_rows = np.flatnonzero(of_label & ~small[parts])
        small_rows = np.flatnonzero(of_label & small[parts])
        if not len(large_rows):
            continue
        distances, nearest = KDTree(points[large_rows]).query(points[small_rows], distance_upper_bound=SMALL_REACH)
        for row in np.argsort(-np.asarray(distances), kind="stable").tolist():  # the nearest is written last
            if np.isfinite(distances[row]):
                joined[parts[small_rows[row]]] = parts[large_rows[nearest[row]]]
    return joined[parts]
