"""Planning the fill of a hole: which ground around is copied where, and which splats are removed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.behind.uprights import Continuation
from instdrive_core.edits.holes.ground_grid import GroundGrid, refine_grid
from instdrive_core.edits.holes.ground_light import GroundLight
from instdrive_core.edits.holes.ground_map import BARE, GROUND_BAND, GroundMap, build_ground_map
from instdrive_core.edits.holes.inpainting import ExemplarConfig, choose_source_cells
from instdrive_core.edits.holes.lanes.carriageway import profile_ground
from instdrive_core.edits.holes.lanes.lane_marks import continue_marks, find_lane_marks
from instdrive_core.edits.holes.nearest_rows import find_nearest_rows
from instdrive_core.edits.holes.seams import blend_copies
from instdrive_core.edits.holes.surroundings import Neighborhood
from instdrive_core.errors import EditError
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.transforms import TransformPalette, bake_transforms

GROUND_PIECES = ExemplarConfig(line_penalty=1.0, guide_penalty=16.0, bound_penalty=0.3)
HEIGHT_WEIGHT = 2.0
"""A metre of height counts in the comparison of pieces like so much of a colour: a kerb like a change of 0.3."""
DETAIL = 3
"""Tiles per side of a cell that show what is copied."""
BED_DEPTH = 0.05
"""Metres below the ground at which larger tiles seal the gaps between those."""
THICKNESS = 0.01
"""Standard deviation along the vertical, metres."""
TILE_OPACITY = 0.95
"""Opacity: nothing beneath shines through."""
TILE_SPREAD = 0.7
"""Standard deviation of a tile's splat in sides of the tile."""
UNDERGROUND = -0.12
"""Metres: what lies lower, beneath and right beside the hole, was only ever seen through what is deleted."""


@dataclass(frozen=True)
class FillPlan:
    """The splats that fill a hole, and those that they replace."""

    tiles: Float64[ndarray, "t 3"]
    """Middles of the flat splats that make up ground, metres."""
    tile_colors: Float64[ndarray, "t 3"]
    tiles_like: Int64[ndarray, " t"]
    """Rows of the document whose other columns (features, codeword) they take."""
    tile_scales: Float64[ndarray, " t"]
    """Standard deviations in metres."""
    replaced: Int64[ndarray, " r"]
    """Rows of the document to delete."""
    uprights: tuple[Continuation, ...] = ()
    """Feet of what stands behind."""
    backdrop: Gaussians | None = None
    """What stands behind; None = nothing is added there."""
    backdrop_like: Int64[ndarray, " b"] = field(default_factory=lambda: np.zeros(0, np.int64))
    """Rows whose other columns it takes."""

    @property
    def likes(self) -> Int64[ndarray, " n"]:
        """Rows of the document that all splats take their other columns from, in the order of `build_splats`."""
        return np.concatenate([self.tiles_like, *(each.copied for each in self.uprights), self.backdrop_like])

    @property
    def feet(self) -> slice:
        """Which of these are the feet's."""
        start = len(self.tiles_like)
        return slice(start, start + sum(len(each.copied) for each in self.uprights))

    def build_splats(self, gaussians: Gaussians, transforms: TransformPalette) -> Gaussians:
        """Ground and backdrop, which look the same from everywhere, and feet; `gaussians` and `transforms` are the
        document's."""
        like, count = gaussians.select(self.tiles_like), len(self.tiles)
        sizes = self.tile_scales[:, None] * np.ones((1, 2))
        ground = replace(
            like,
            means=self.tiles.astype(np.float32),
            quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
            log_scales=np.log(np.c_[sizes, np.full(count, THICKNESS)]).astype(np.float32),
            opacity_logits=logit(np.full(count, TILE_OPACITY, np.float32)),
            sh_dc=dc_from_color(self.tile_colors).astype(np.float32),
            sh_rest=np.zeros_like(like.sh_rest),
        )
        parts = [ground, *(_copy_lower(gaussians, transforms, each) for each in self.uprights)]
        if self.backdrop is not None:
            parts.append(replace(self.backdrop, features=gaussians.features[self.backdrop_like]))
        return concatenate_gaussians(parts)


def _copy_lower(gaussians: Gaussians, transforms: TransformPalette, foot: Continuation) -> Gaussians:
    """Copies of splats as they are shown now, each lower by its drop."""
    part = gaussians.select(foot.copied)
    bake_transforms(part, transforms, transforms.indices[foot.copied])
    part.means[:, 2] -= foot.drops.astype(np.float32)
    return part


def plan_nothing() -> FillPlan:
    """A plan that leaves the ground as it is."""
    rows, places = np.zeros(0, np.int64), np.zeros((0, 3))
    return FillPlan(places, places, rows, np.zeros(0), rows)


def plan_fill(
    near: Neighborhood,
    hole: Bool[ndarray, "a b"],
    ground: GroundMap,
    known: Bool[ndarray, "a b"],
    rng: np.random.Generator,
    lowest: Bool[ndarray, " b"] | None = None,
    light: GroundLight | None = None,
) -> FillPlan:
    """Plan which ground is copied where; only `known` cells are copied. Raises EditError where there are none.

    Pieces are chosen cell by cell; colours are copied in a finer grid, where their seams are blended. With `light`, as
    they would be in the sun.
    """
    grid = ground.grid
    profile = profile_ground(ground, known & ~hole, lowest)
    if light is not None:
        known = light.find_sources(known)
    sources = choose_ground_pieces(ground, known, hole, rng, profile, light)
    if sources is None:
        raise EditError("no ground around the hole was seen well enough to be copied")
    copied = np.maximum(sources, 0)
    heights = np.where(hole, (ground.height - profile)[copied[..., 0], copied[..., 1]] + profile, ground.height)
    fine = build_ground_map(refine_grid(grid, DETAIL), near)
    offsets = np.repeat(np.repeat(sources - np.indices(hole.shape).transpose(1, 2, 0), DETAIL, 0), DETAIL, 1) * DETAIL
    fine_hole, fine_known = (np.kron(each, np.ones((DETAIL, DETAIL), bool)) for each in (hole, known))
    broad = np.repeat(np.repeat(ground.color, DETAIL, axis=0), DETAIL, axis=1)
    shown = np.where((fine.cover >= BARE)[..., None], fine.color, broad)
    levels = np.repeat(np.repeat(profile, DETAIL, axis=0), DETAIL, axis=1)
    shares = np.ones((1, 1, 3)) if light is None else light.refine(DETAIL).compute_shares(fine_hole, DETAIL)
    colors = blend_copies(shown / shares, fine_known, fine_hole, offsets, levels=levels) * shares
    surface = _lay_tiles(fine.grid, fine_hole, np.kron(heights, np.ones((DETAIL, DETAIL))))
    bed = _lay_tiles(grid, hole, heights - BED_DEPTH)
    bed_colors = colors.reshape(hole.shape[0], DETAIL, hole.shape[1], DETAIL, 3).mean(axis=(1, 3))[hole]
    places = np.concatenate([surface, bed])
    flat = np.flatnonzero(ground.ground)
    origins = np.concatenate([np.argwhere(fine_hole) // DETAIL, np.argwhere(hole)])
    like = flat[find_nearest_rows(near.means[flat][:, :2], grid.compute_centers(sources[tuple(origins.T)]))]
    scales = TILE_SPREAD * np.repeat([fine.grid.size, grid.size], [len(surface), len(bed)])
    return FillPlan(
        places, np.clip(np.concatenate([colors[fine_hole], bed_colors]), 0, 1), near.rows[like], scales,
        near.rows[_find_replaced(grid, near, hole)],
    )  # fmt: skip


def find_filled_levels(ground: GroundMap, plan: FillPlan, places: Float64[ndarray, "k 2"]) -> Float64[ndarray, " k"]:
    """Height of the ground in the world (metres) at x and y, once it is filled."""
    grid = ground.grid
    cells = np.clip(grid.find_cells(places), 0, np.array(grid.shape) - 1)
    levels = grid.lift_to_ground(places)[:, 2] + ground.height[tuple(cells.T)]
    if len(plan.tiles):
        nearest = plan.tiles[find_nearest_rows(plan.tiles[:, :2], places)]
        away = np.linalg.norm(nearest[:, :2] - places, axis=1)
        levels = np.where(away <= grid.size, nearest[:, 2], levels)
    return levels


def choose_ground_pieces(
    ground: GroundMap,
    known: Bool[ndarray, "a b"],
    hole: Bool[ndarray, "a b"],
    rng: np.random.Generator,
    profile: Float64[ndarray, "a b"],
    light: GroundLight | None = None,
) -> Int64[ndarray, "a b 2"] | None:
    """For each cell of the hole the `known` cell to copy, -1 elsewhere; None where nothing is known.

    `profile` says how high the ground is that belongs to each cell, metres. With `light`, ground is compared as it
    would be in the sun.
    """
    color = ground.color if light is None else ground.color / light.compute_shares(hole)
    values = np.dstack([color, HEIGHT_WEIGHT * ground.height])
    costs = None if light is None else light.compute_costs()
    marks = find_lane_marks(color.mean(axis=2), ground.height, known & ~hole, ground.grid.size)
    sources = choose_source_cells(values, known, hole, rng, GROUND_PIECES, profile, costs, marks)
    return None if sources is None else continue_marks(sources, marks, known & ~hole, hole, ground.grid.size)


def _lay_tiles(
    grid: GroundGrid, hole: Bool[ndarray, "a b"], heights: Float64[ndarray, "a b"]
) -> Float64[ndarray, "h 3"]:
    """Middles of the hole's cells at `heights` (metres) above the plane."""
    places = grid.lift_to_ground(grid.compute_centers(np.argwhere(hole)))
    places[:, 2] += heights[hole]
    return places


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
