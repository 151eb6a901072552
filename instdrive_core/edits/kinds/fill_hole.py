"""Filling ground that was never seen with copies of the ground around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray

from instdrive_core.edits.bases.append import Addition, AppendEdit
from instdrive_core.edits.bases.flags import FlagChange
from instdrive_core.edits.bases.growth import flag_like_others
from instdrive_core.edits.bases.parameters import (
    check_ids,
    check_number,
    check_number_list,
    check_switch,
    check_vector,
    is_whole,
)
from instdrive_core.edits.bases.relabel import MAX_NAME_LENGTH, create_instances
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import CONTENT, fingerprint
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC
from instdrive_core.edits.holes.behind.backdrop import MAX_LOOKS, plan_backdrop
from instdrive_core.edits.holes.behind.look_picture import Remains
from instdrive_core.edits.holes.behind.seen_through import PhotoDepths
from instdrive_core.edits.holes.behind.uprights import continue_uprights
from instdrive_core.edits.holes.cast_shadow import find_shaded_cells, lies_in_shade
from instdrive_core.edits.holes.deleted_neighbors import pick_unfilled
from instdrive_core.edits.holes.fill_plan import FillPlan, find_filled_levels, plan_fill, plan_nothing
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.holes import HALF_LENGTH, HALF_WIDTH, Hole, find_known_ground
from instdrive_core.edits.holes.lanes.parking_lines import find_parking_lines
from instdrive_core.edits.holes.photo_evidence import Look, PhotoEvidence, PhotoRecord, gather_photo_evidence
from instdrive_core.edits.holes.sunlight.stretch_light import find_hole_light
from instdrive_core.edits.holes.surroundings import StandingObject, find_neighborhood
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.queries.compact_objects import select_solid_points
from instdrive_core.errors import EditError
from instdrive_core.maths.vectors import Vector
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import find_away
from instdrive_core.wording import phrase


@dataclass
class FillHole(AppendEdit):
    """Clone neighbouring ground into cells whose ground was never seen, in place of what lies there.

    Copies are marked as synthetic: by the column `synthetic` and an instance of their own, but for the feet of poles
    and trunks, which belong to these. What the hole held, at ground level and below, is deleted.
    """

    kind: ClassVar[str] = "fill_hole"
    cells: tuple[object, ...]
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
    """Name of the new instance."""
    seed: int = 0
    """Seed of the choice among pieces of ground that fit equally well."""
    lit: bool = False
    """Whether shaded ground is not copied into a hole in the sun. Only projects of earlier versions ask for this: a
    thing in the shade has dark ground beside it, too, and what was copied there came from the sun."""
    behind: tuple[int, ...] = ()
    """Deleted instances: what no photo reached past them is closed, too, and what it showed instead is deleted."""
    beside: tuple[int, ...] = ()
    """Deleted instances around: where no fill has closed their holes, nothing is copied from there."""
    _flags_done: list[FlagChange] = field(default_factory=list, init=False, repr=False, compare=False)
    _new_column: bool = field(default=False, init=False, repr=False, compare=False)
    _filling: FillPlan | None = field(default=None, init=False, repr=False, compare=False)
    _planned_for: bytes = field(default=b"", init=False, repr=False, compare=False)
    _record: PhotoRecord | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.behind = check_ids(self.behind) if self.behind else ()
        self.beside = check_ids(self.beside) if self.beside else ()
        self.cells = _check_cells(self.cells, may_be_none=bool(self.behind))
        (x, y), (ax, ay) = check_number_list(self.corner, "corner", 2), check_number_list(self.along, "along", 2)
        if not 0.99 < np.hypot(ax, ay) < 1.01:
            raise EditError(phrase("along {along!r} is no unit vector", along=self.along))
        self.corner, self.along = (x, y), (ax, ay)
        self.plane = check_vector(self.plane, "plane")
        self.size = check_number(self.size, "size")
        if not 0.01 <= self.size <= 10:
            raise EditError(phrase("size {size!r} of a cell is not 0.01 to 10 metres", size=self.size))
        if not isinstance(self.name, str) or not self.name.isprintable() or not 0 < len(self.name) <= MAX_NAME_LENGTH:
            raise EditError(
                phrase(
                    "name {name!r} is not a line of 1 to {most} characters",
                    name=self.name,
                    most=MAX_NAME_LENGTH,
                )
            )
        check_switch(self.lit, "lit")
        if not is_whole(self.seed) or not 0 <= self.seed < 2**32:
            raise EditError(
                phrase("seed {seed!r} is not a whole number from 0 to {most}", seed=self.seed, most=2**32 - 1)
            )

    @property
    def area(self) -> float:
        """Square metres of all cells, those in the cast shadow included."""
        return len(self.cells) * self.size**2

    @property
    def title(self) -> str:
        """``Fill hole of 7.2 m²``, or ``Fill gap`` where no ground is missing."""
        if not self.cells:
            return phrase("Fill gap")
        return phrase("Fill hole of {area:.1f} m²", area=self.area)

    @property
    def shift(self) -> Vector:
        """No shift: copies are placed one by one."""
        return (0.0, 0.0, 0.0)

    def remember(self, record: PhotoRecord | None) -> None:
        """Take over what a report saw in the photos, so that planning need not look again; the plan is the same."""
        self._record = record

    def prepare(self, document: Document) -> None:
        """Plan what to copy, which takes a second: `do` on an equal document is then quick.

        Give a frozen copy to do this on another thread. Raises EditError where there is no ground to copy.
        """
        key = fingerprint(document, CONTENT)
        if self._filling is None or self._planned_for != key:
            self._filling, self._planned_for = self._plan(document), key
            self._record = None

    def is_prepared_for(self, document: Document) -> bool:
        """Whether it is known what to copy in a document with this content."""
        return self._filling is not None and self._planned_for == fingerprint(document, CONTENT)

    @property
    def lays_nothing(self) -> bool:
        """Whether the plan has nothing to copy: nothing around goes on there."""
        return self._filling is not None and not len(self._filling.likes)

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
        for number in np.unique(document.scene.instance_ids[filling.likes[filling.feet]]).tolist():
            flag_like_others(document, number, self._count)
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

    def build_addition(self, document: Document) -> Addition:
        """Ground and what stands behind under one new instance, feet under those that they belong to."""
        assert self._filling is not None
        filling, scene = self._filling, document.scene
        entry = replace(create_instances(document, [None])[0], name=self.name, class_name=SYNTHETIC)
        rows = filling.likes
        count = len(rows)
        extra = {name: column[rows] for name, column in scene.extra.items()}
        extra[SYNTHETIC] = np.ones(count, scene.extra[SYNTHETIC].dtype)
        ids = np.full(count, entry.id, np.uint32)
        ids[filling.feet] = scene.instance_ids[rows[filling.feet]]
        added = Scene(
            filling.build_splats(scene.gaussians, document.transforms),
            ids,
            scene.codewords[rows],
            np.zeros(count, np.uint16),
            extra=extra,
        )
        # What stands behind has the colours that are shown already.
        colors = document.colors.indices[rows]
        colors[count - len(filling.backdrop_like) :] = 0
        grown = [scene.table[number] for number in np.unique(ids[filling.feet]).tolist()]
        return Addition(added, colors, np.zeros(count, np.uint16), (entry, *grown))

    def _drop_column(self, document: Document) -> None:
        if self._new_column:
            del document.scene.extra[SYNTHETIC]
            self._new_column = False

    def _plan(self, document: Document) -> FillPlan:
        rng = np.random.default_rng(self.seed)  # bare, so that saved projects replay: see `maths.streams`
        evidence = self._gather_evidence(document)
        lost = np.zeros(0, np.int64) if evidence is None else evidence.lost
        looks = () if evidence is None else evidence.looks
        beside = self._find_beside(document)
        plan = self._plan_ground(document, lost, looks, beside, rng) if self.cells else plan_nothing()
        if evidence is None:
            return plan
        plan = replace(plan, replaced=np.union1d(plan.replaced, lost))
        rows = np.arange(len(document.scene))
        left = np.setdiff1d(rows[~find_away(document.transforms, rows)], plan.replaced, assume_unique=True)
        left = left[~document.state.find_mask(Flag.DELETED)[left]]
        hiding = np.concatenate([np.zeros((0, 3)), *(each.points for each in beside)])
        remains = Remains(bake_document(document, rows=left), np.isin(left, evidence.seen), hiding)
        ground = plan.build_splats(document.scene.gaussians, document.transforms)
        looks = evidence.looks[:MAX_LOOKS] if self.cells else evidence.looks
        backdrop = plan_backdrop(remains, ground, self.plane, looks, rng, PhotoDepths(document))
        return replace(plan, backdrop=backdrop.gaussians, backdrop_like=left[backdrop.like])

    def _gather_evidence(self, document: Document) -> PhotoEvidence | None:
        rows = [document.find_rows((number,)) for number in self.behind if number in document.scene.table]
        deleted = document.state.find_mask(Flag.DELETED)
        if not rows:
            return None
        gone = [each[deleted[each] | find_away(document.transforms, each)] for each in rows]
        kept = [np.setdiff1d(each, part, assume_unique=True) for each, part in zip(rows, gone, strict=True)]
        return gather_photo_evidence(document, gone, kept, self._record)

    def _plan_ground(
        self,
        document: Document,
        lost: Int64[ndarray, " l"],
        looks: tuple[Look, ...],
        beside: tuple[StandingObject, ...],
        rng: np.random.Generator,
    ) -> FillPlan:
        cells = np.array(self.cells, np.int64)
        grid = GroundGrid(self.corner, self.along, self.size, (1, 1), self.plane)
        middle = (cells.min(axis=0) + cells.max(axis=0)) // 2
        half = np.ceil(np.array([HALF_LENGTH, HALF_WIDTH]) / self.size).astype(np.int64)
        start = np.clip(middle - half, cells.max(axis=0) + 1 - 2 * half, cells.min(axis=0))
        x, y = (np.array(self.corner) + self.size * start @ grid.axes).tolist()
        grid = replace(grid, corner=(x, y), shape=(int(2 * half[0]), int(2 * half[1])))
        hole = np.zeros(grid.shape, bool)
        inside = cells - start
        if not grid.contains(inside).all():
            raise EditError(
                phrase(
                    "the hole is longer than {length:g} m or wider than {width:g} m",
                    length=2 * HALF_LENGTH,
                    width=2 * HALF_WIDTH,
                )
            )
        hole[tuple(inside.T)] = True
        place = grid.lift_to_ground(grid.compute_centers((middle - start)[None]))[0]
        near = find_neighborhood(document, place).exclude(lost)
        ground, known = find_known_ground(document, grid, near, hole, beside)
        shaded = find_shaded_cells(ground, known)
        if self.lit and not lies_in_shade(shaded, known, hole, grid.size):
            known &= ~shaded
        lowest = self._find_parking_lines(document, grid)
        light = find_hole_light(document, ground, known, hole, lowest, lost)
        plan = plan_fill(near, hole, ground, known, rng, lowest, light)
        feet = continue_uprights(near, looks, lambda places: find_filled_levels(ground, plan, places))
        replaced = np.unique(np.concatenate([plan.replaced, *(each.replaced for each in feet)]))
        return replace(plan, uprights=feet, replaced=replaced)

    def _find_beside(self, document: Document) -> tuple[StandingObject, ...]:
        numbers = [number for number in self.beside if number in document.scene.table]
        things = [(number, document.find_rows((number,))) for number in numbers]
        return pick_unfilled(document, things)

    def _find_parking_lines(self, document: Document, grid: GroundGrid) -> Bool[ndarray, " b"] | None:
        lines = np.zeros(grid.shape[1], bool)
        for number in self.behind:
            if number in document.scene.table:
                rows = document.find_rows((number,))
                rows = rows[(document.scene.nodes[rows] == 0) & ~find_away(document.transforms, rows)]
                lines |= find_parking_lines(select_solid_points(document, rows), grid)
        return lines if lines.any() else None


def _check_cells(cells: Sequence[object], may_be_none: bool) -> tuple[tuple[int, int], ...]:
    pairs = []
    for cell in cells:
        if not isinstance(cell, tuple | list):
            raise EditError(phrase("cell {cell!r} is not two whole numbers", cell=cell))
        whole = [each for each in cell if is_whole(each) and abs(each) < 2**31]
        if len(cell) != 2 or len(whole) != 2:
            raise EditError(phrase("cell {cell!r} is not two whole numbers", cell=cell))
        pairs.append((whole[0], whole[1]))
    if not pairs and not may_be_none:
        raise EditError("a hole without cells cannot be filled")
    return tuple(sorted(set(pairs)))


def make_fill_hole(hole: Hole, name: str, seed: int = 0) -> FillHole:
    """The edit that fills a hole and replaces the ground in the shadow."""
    grid = hole.grid
    cells = tuple((along, across) for along, across in np.concatenate([hole.cells, hole.shadow]).tolist())
    return FillHole(
        cells, grid.corner, grid.along, grid.size, grid.plane, name, seed, behind=hole.behind, beside=hole.beside
    )
