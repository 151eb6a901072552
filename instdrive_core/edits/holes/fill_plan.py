"""Planning the fill of a hole: which splats of the ground around are copied where, and which are removed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy import ndimage
from scipy.spatial import KDTree

from instdrive_core.edits.document.row_index import RowIndex
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_map import GROUND_BAND, GroundMap
from instdrive_core.edits.holes.inpainting import choose_source_cells
from instdrive_core.edits.holes.surroundings import Neighborhood
from instdrive_core.errors import EditError
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.gaussians import Gaussians

HEIGHT_WEIGHT = 2.0
"""A metre of height counts in the comparison of pieces like so much of a colour: a kerb like a change of 0.3."""
ROAD_BAND = 0.08
"""Metres from the plane within which a cell is taken for carriageway, lower than kerbs."""
ROAD_SMOOTHING = 1.5
"""Metres over which the carriageway's height is averaged."""
BED_DEPTH = 0.05
"""Metres below the ground at which a bed seals the gaps between copies."""
BED_THICKNESS = 0.01
"""Standard deviation along the vertical, metres."""
BED_OPACITY = 0.95
"""Opacity of the bed's splats: nothing beneath shines through."""
BED_SPREAD = 0.7
"""Standard deviation of a splat of the bed in cells."""
UNDERGROUND = -0.12
"""Metres: what lies lower, beneath and right beside the hole, was only ever seen through what is deleted."""


@dataclass(frozen=True)
class FillPlan:
    """The splats that fill a hole, and those that they replace."""

    sources: Int64[ndarray, " s"]
    """Rows of the document to copy."""
    shifts: Float64[ndarray, "s 3"]
    """Metres from each source to its copy."""
    bed: Float64[ndarray, "h 3"]
    """Middles of the splats that seal gaps from below, metres."""
    bed_colors: Float64[ndarray, "h 3"]
    bed_like: Int64[ndarray, " h"]
    """Rows whose other columns (features, codeword) the bed takes."""
    bed_scale: float
    """Standard deviation in metres."""
    replaced: Int64[ndarray, " r"]
    """Rows of the document to delete."""

    def build_bed(self, gaussians: Gaussians) -> Gaussians:
        """The bed as flat level splats that look the same from everywhere; `gaussians` are the document's."""
        like = gaussians.select(self.bed_like)
        count = len(like)
        scales = np.tile(np.array([self.bed_scale, self.bed_scale, BED_THICKNESS], np.float32), (count, 1))
        return replace(
            like,
            means=self.bed.astype(np.float32),
            quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
            log_scales=np.log(scales),
            opacity_logits=logit(np.full(count, BED_OPACITY, np.float32)),
            sh_dc=dc_from_color(self.bed_colors).astype(np.float32),
            sh_rest=np.zeros_like(like.sh_rest),
        )


def plan_fill(
    near: Neighborhood,
    hole: Bool[ndarray, "a b"],
    ground: GroundMap,
    known: Bool[ndarray, "a b"],
    rng: np.random.Generator,
) -> FillPlan:
    """Plan which splats are copied where; only `known` cells are copied. Raises EditError where there are none."""
    grid = ground.grid
    values = np.dstack([ground.color, HEIGHT_WEIGHT * ground.height])
    sources = choose_source_cells(values, known, hole, rng)
    if sources is None:
        raise EditError("no ground around the hole was seen well enough to be copied")
    cells = np.argwhere(hole)
    origins = sources[tuple(cells.T)]
    level = _estimate_road_level(ground, known)
    lift = level[tuple(cells.T)] - level[tuple(origins.T)]
    rows, targets = _match_splats(grid, near, ground, origins)
    shifts = np.zeros((len(rows), 3))
    shifts[:, :2] = grid.size * (cells[targets] - origins[targets]) @ grid.axes
    shifts[:, 2] = shifts[:, :2] @ np.array(grid.plane[1:]) + lift[targets]
    places = grid.lift_to_ground(grid.compute_centers(cells))
    places[:, 2] += ground.height[tuple(origins.T)] + lift - BED_DEPTH
    flat = np.flatnonzero(ground.ground)
    like = flat[_find_nearest_rows(grid, near, flat, origins)]
    colors = np.clip(ground.color[tuple(origins.T)], 0, 1)
    return FillPlan(
        near.rows[rows], shifts, places, colors, near.rows[like], BED_SPREAD * grid.size,
        near.rows[_find_replaced(grid, near, hole)],
    )  # fmt: skip


def _estimate_road_level(ground: GroundMap, good: Bool[ndarray, "a b"]) -> Float64[ndarray, "a b"]:
    """Metres above the plane of the carriageway under or beside each cell: roads are cambered, kerbs do not count."""
    low = good & (np.abs(ground.height) <= ROAD_BAND)
    spread = ROAD_SMOOTHING / ground.grid.size
    weights = ndimage.gaussian_filter(low.astype(np.float64), spread, mode="nearest")
    sums = ndimage.gaussian_filter(np.where(low, ground.height, 0), spread, mode="nearest")
    return sums / np.maximum(weights, 1e-6)


def _match_splats(
    grid: GroundGrid, near: Neighborhood, ground: GroundMap, origins: Int64[ndarray, "h 2"]
) -> tuple[Int64[ndarray, " s"], Int64[ndarray, " s"]]:
    """Splats of the neighbourhood whose middle lies in a source cell, and the hole's cell they are copied to."""
    flat = np.flatnonzero(ground.ground)
    cells = grid.find_cells(near.means[flat])
    flat, cells = flat[grid.contains(cells)], cells[grid.contains(cells)]
    index = RowIndex((cells @ np.array([grid.shape[1], 1])).astype(np.uint32))
    found = [index.rows((number,)) for number in (origins @ np.array([grid.shape[1], 1])).tolist()]
    targets = np.repeat(np.arange(len(origins)), [len(rows) for rows in found])
    return flat[np.concatenate([np.zeros(0, np.int64), *found])], targets


def _find_nearest_rows(
    grid: GroundGrid, near: Neighborhood, flat: Int64[ndarray, " f"], cells: Int64[ndarray, "h 2"]
) -> Int64[ndarray, " h"]:
    return np.asarray(KDTree(near.means[flat][:, :2]).query(grid.compute_centers(cells))[1])


def _find_replaced(grid: GroundGrid, near: Neighborhood, hole: Bool[ndarray, "a b"]) -> Int64[ndarray, " r"]:
    """Rows that lie in the hole at ground level, or below ground under it and right beside it."""
    cells = grid.find_cells(near.means)
    inside = grid.contains(cells)
    cells = np.where(inside[:, None], cells, 0)
    heights = grid.compute_heights(near.means)
    at_level = hole[tuple(cells.T)] & (heights <= GROUND_BAND[1])
    around: Bool[ndarray, "a b"] = np.asarray(ndimage.binary_dilation(hole, iterations=2), bool)
    beside = around[tuple(cells.T)] & (heights <= UNDERGROUND)
    return np.flatnonzero(inside & (at_level | beside) & ~near.compact & ~near.locked)
