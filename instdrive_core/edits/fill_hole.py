"""Filling ground that was never seen with copies of the ground around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy import ndimage
from scipy.spatial import KDTree

from instdrive_core.edits.append import Addition, AppendEdit
from instdrive_core.edits.base import checked_switch
from instdrive_core.edits.document import Document
from instdrive_core.edits.exemplars import source_cells
from instdrive_core.edits.flags import FlagChange
from instdrive_core.edits.frozen_copy import fingerprint
from instdrive_core.edits.ground_grid import GroundGrid
from instdrive_core.edits.holes import GROUND_BAND, HALF_LENGTH, HALF_WIDTH, GroundMap, Hole, known_ground, shaded
from instdrive_core.edits.instances import MAX_NAME_LENGTH, new_instances
from instdrive_core.edits.placement import Vector, checked_numbers, checked_vector
from instdrive_core.edits.row_index import RowIndex
from instdrive_core.edits.surroundings import Neighborhood, neighborhood
from instdrive_core.errors import EditError
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.gaussians import Gaussians, concatenated
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import transformed

SYNTHETIC = "synthetic"
"""Name of the per-splat column that is 1 for splats no photo was the reason for, and the class of their instances."""
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
BED_SPREAD = 0.7
"""Standard deviation of a splat of the bed in cells."""
UNDERGROUND = -0.12
"""Metres: what lies lower, beneath and right beside the hole, was only ever seen through what is deleted."""


@dataclass
class FillHole(AppendEdit):
    """Clone neighbouring ground into cells whose ground was never seen, in place of what lies there.

    Copies are marked as synthetic: by the column `synthetic` and an instance of their own. What the hole held, at
    ground level and below, is deleted.
    """

    kind: ClassVar[str] = "fill_hole"
    cells: tuple[Any, ...]
    """Pairs: places of the cells along and across the lane."""
    corner: tuple[float, float]
    """World x and y (metres) of the outer corner of cell (0, 0)."""
    along: tuple[float, float]
    """Horizontal unit vector of the lane."""
    size: float
    """Metres per side of a cell."""
    plane: Vector
    """Height of the ground plane at the world's origin (metres) and its slopes along x and y."""
    name: str = "fill"
    """Of the new instance."""
    seed: int = 0
    """Draws among pieces of ground that fit as well."""
    lit: bool = False
    """Whether the hole lies in the sun, so that ground in the shadow of other things is not copied."""
    _flags_done: list[FlagChange] = field(default_factory=list, init=False, repr=False, compare=False)
    _new_column: bool = field(default=False, init=False, repr=False, compare=False)
    _filling: Filling | None = field(default=None, init=False, repr=False, compare=False)
    _planned_for: bytes = field(default=b"", init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.cells = _checked_cells(self.cells)
        (x, y), (ax, ay) = checked_numbers(self.corner, "corner", 2), checked_numbers(self.along, "along", 2)
        if not 0.99 < np.hypot(ax, ay) < 1.01:
            raise EditError(f"along {self.along!r} is no unit vector")
        self.corner, self.along = (x, y), (ax, ay)
        self.plane = checked_vector(self.plane, "plane")
        self.size = checked_numbers((self.size,), "size", 1)[0]
        if not 0.01 <= self.size <= 10:
            raise EditError(f"size {self.size!r} of a cell is not 0.01 to 10 metres")
        if not isinstance(self.name, str) or not self.name.isprintable() or not 0 < len(self.name) <= MAX_NAME_LENGTH:
            raise EditError(f"name {self.name!r} is not a line of 1 to {MAX_NAME_LENGTH} characters")
        checked_switch(self.lit, "lit")
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or not 0 <= self.seed < 2**32:
            raise EditError(f"seed {self.seed!r} is not a whole number from 0 to {2**32 - 1}")

    @property
    def title(self) -> str:
        """``Fill hole of 7.2 m²``."""
        return f"Fill hole of {len(self.cells) * self.size**2:.1f} m²"

    @property
    def shift(self) -> Vector:
        """None: copies are placed one by one."""
        return (0.0, 0.0, 0.0)

    def prepare(self, document: Document) -> None:
        """Find out what to copy, which takes a second: `do` on an equal document is then quick.

        Give a frozen copy to do this on another thread. Raises EditError where there is no ground to copy.
        """
        key = fingerprint(document)
        if self._filling is None or self._planned_for != key:
            self._filling, self._planned_for = self._planned(document), key

    def do(self, document: Document) -> bool:
        """Add the copies, then delete what they replace."""
        self.prepare(document)
        filling = self._filling
        assert filling is not None
        self._new_column = SYNTHETIC not in document.scene.extra
        if self._new_column:
            document.scene.extra[SYNTHETIC] = np.zeros(len(document.scene), np.uint8)
        try:
            super().do(document)
        except Exception:
            self._drop_column(document)
            raise
        self._flags_done = []
        for flag, on in ((Flag.SELECTED, False), (Flag.DELETED, True)):
            changed = document.state.change(filling.replaced, flag, on)
            self._flags_done.append(FlagChange(changed.astype(np.int32), flag, on))
        return True

    def undo(self, document: Document) -> None:
        """Bring back what was replaced and take the copies away."""
        for rows, flag, on in reversed(self._flags_done):
            document.state.change(rows, flag, not on)
        super().undo(document)
        self._drop_column(document)

    def addition(self, document: Document) -> Addition:
        """Copies and bed under one new instance."""
        assert self._filling is not None
        filling, scene = self._filling, document.scene
        entry = replace(new_instances(document, [None])[0], name=self.name, class_name=SYNTHETIC)
        copies = transformed(scene.gaussians, document.transforms, filling.sources)
        copies.means = (copies.means + filling.shifts).astype(np.float32)
        rows = np.concatenate([filling.sources, filling.bed_like])
        count = len(rows)
        extra = {name: column[rows] for name, column in scene.extra.items()}
        extra[SYNTHETIC] = np.ones(count, scene.extra[SYNTHETIC].dtype)
        added = Scene(
            concatenated([copies, filling.bed_of(scene.gaussians)]),
            np.full(count, entry.id, np.uint32),
            scene.codewords[rows],
            np.zeros(count, np.uint16),
            extra=extra,
        )
        colors = document.colors.indices[rows]
        return Addition(added, colors, np.zeros(count, np.uint16), (entry,))

    def _drop_column(self, document: Document) -> None:
        if self._new_column:
            del document.scene.extra[SYNTHETIC]
            self._new_column = False

    def _planned(self, document: Document) -> Filling:
        cells = np.array(self.cells, np.int64)
        grid = GroundGrid(self.corner, self.along, self.size, (1, 1), self.plane)
        middle = (cells.min(axis=0) + cells.max(axis=0)) // 2
        half = np.ceil(np.array([HALF_LENGTH, HALF_WIDTH]) / self.size).astype(np.int64)
        start = middle - half
        x, y = (np.array(self.corner) + self.size * start @ grid.axes).tolist()
        grid = replace(grid, corner=(x, y), shape=(int(2 * half[0]), int(2 * half[1])))
        hole = np.zeros(grid.shape, bool)
        inside = cells - start
        if not grid.inside(inside).all():
            raise EditError(f"the hole is longer than {2 * HALF_LENGTH:g} m or wider than {2 * HALF_WIDTH:g} m")
        hole[tuple(inside.T)] = True
        place = grid.on_ground(grid.centers((middle - start)[None]))[0]
        near = neighborhood(document, place)
        ground, known = known_ground(document, grid, near)
        if self.lit:
            known &= ~shaded(ground, known)
        return planned_filling(near, hole, ground, known, np.random.default_rng(self.seed))


@dataclass(frozen=True)
class Filling:
    """What fills a hole."""

    sources: Int64[ndarray, " s"]
    """Rows to be copied."""
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
    """Rows that go."""

    def bed_of(self, gaussians: Gaussians) -> Gaussians:
        """Flat level splats, the same from everywhere."""
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


def planned_filling(
    near: Neighborhood,
    hole: Bool[ndarray, "a b"],
    ground: GroundMap,
    known: Bool[ndarray, "a b"],
    rng: np.random.Generator,
) -> Filling:
    """Which splats go where: only `known` cells are copied. Raises EditError where there are none."""
    grid = ground.grid
    values = np.dstack([ground.color, HEIGHT_WEIGHT * ground.height])
    sources = source_cells(values, known, hole, rng)
    if sources is None:
        raise EditError("no ground around the hole was seen well enough to be copied")
    cells = np.argwhere(hole)
    origins = sources[tuple(cells.T)]
    level = _road_level(ground, known)
    lift = level[tuple(cells.T)] - level[tuple(origins.T)]
    rows, targets = _splats_of(grid, near, ground, origins)
    shifts = np.zeros((len(rows), 3))
    shifts[:, :2] = grid.size * (cells[targets] - origins[targets]) @ grid.axes
    shifts[:, 2] = shifts[:, :2] @ np.array(grid.plane[1:]) + lift[targets]
    places = grid.on_ground(grid.centers(cells))
    places[:, 2] += ground.height[tuple(origins.T)] + lift - BED_DEPTH
    flat = np.flatnonzero(ground.ground)
    like = flat[_nearest_rows(grid, near, flat, origins)]
    colors = np.clip(ground.color[tuple(origins.T)], 0, 1)
    return Filling(
        near.rows[rows], shifts, places, colors, near.rows[like], BED_SPREAD * grid.size,
        near.rows[_replaced(grid, near, hole)],
    )  # fmt: skip


def _road_level(ground: GroundMap, good: Bool[ndarray, "a b"]) -> Float64[ndarray, "a b"]:
    """Metres above the plane of the carriageway under or beside each cell: roads are cambered, kerbs do not count."""
    low = good & (np.abs(ground.height) <= ROAD_BAND)
    spread = ROAD_SMOOTHING / ground.grid.size
    weights = ndimage.gaussian_filter(low.astype(np.float64), spread, mode="nearest")
    sums = ndimage.gaussian_filter(np.where(low, ground.height, 0), spread, mode="nearest")
    return sums / np.maximum(weights, 1e-6)


def _splats_of(
    grid: GroundGrid, near: Neighborhood, ground: GroundMap, origins: Int64[ndarray, "h 2"]
) -> tuple[Int64[ndarray, " s"], Int64[ndarray, " s"]]:
    """Splats of the neighbourhood whose middle lies in a source cell, and the hole's cell they are copied to."""
    flat = np.flatnonzero(ground.ground)
    cells = grid.cells_of(near.means[flat])
    flat, cells = flat[grid.inside(cells)], cells[grid.inside(cells)]
    index = RowIndex((cells @ np.array([grid.shape[1], 1])).astype(np.uint32))
    found = [index.rows((number,)) for number in (origins @ np.array([grid.shape[1], 1])).tolist()]
    targets = np.repeat(np.arange(len(origins)), [len(rows) for rows in found])
    return flat[np.concatenate([np.zeros(0, np.int64), *found])], targets


def _nearest_rows(
    grid: GroundGrid, near: Neighborhood, flat: Int64[ndarray, " f"], cells: Int64[ndarray, "h 2"]
) -> Int64[ndarray, " h"]:
    return np.asarray(KDTree(near.means[flat][:, :2]).query(grid.centers(cells))[1])


def _replaced(grid: GroundGrid, near: Neighborhood, hole: Bool[ndarray, "a b"]) -> Int64[ndarray, " r"]:
    """What lies in the hole at ground level, and under it and right beside it below."""
    cells = grid.cells_of(near.means)
    inside = grid.inside(cells)
    cells = np.where(inside[:, None], cells, 0)
    heights = grid.heights(near.means)
    at_level = hole[tuple(cells.T)] & (heights <= GROUND_BAND[1])
    around: Bool[ndarray, "a b"] = np.asarray(ndimage.binary_dilation(hole, iterations=2), bool)
    beside = around[tuple(cells.T)] & (heights <= UNDERGROUND)
    return np.flatnonzero(inside & (at_level | beside) & ~near.compact & ~near.locked)


def _checked_cells(cells: Sequence[Any]) -> tuple[tuple[int, int], ...]:
    pairs = []
    for cell in cells:
        if not isinstance(cell, tuple | list):
            raise EditError(f"cell {cell!r} is not two whole numbers")
        whole = [each for each in cell if isinstance(each, int) and not isinstance(each, bool) and abs(each) < 2**31]
        if len(cell) != 2 or len(whole) != 2:
            raise EditError(f"cell {cell!r} is not two whole numbers")
        pairs.append((whole[0], whole[1]))
    if not pairs:
        raise EditError("a hole without cells cannot be filled")
    return tuple(sorted(set(pairs)))


def fill_of(hole: Hole, name: str, seed: int = 0) -> FillHole:
    """The edit that fills a hole and lights the shadow."""
    grid = hole.grid
    cells = tuple((along, across) for along, across in np.concatenate([hole.cells, hole.shadow]).tolist())
    return FillHole(cells, grid.corner, grid.along, grid.size, grid.plane, name, seed, lit=len(hole.shadow) > 0)
