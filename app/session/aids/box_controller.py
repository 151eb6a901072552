"""The box: selects, deletes or shows only what is inside it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count

import numpy as np
from jaxtyping import Bool, Float, Int64
from numpy import ndarray

from instdrive_app.session.aids.box_handles import find_inside, turn_box
from instdrive_app.session.context import SessionContext
from instdrive_app.session.selection_box import Box, SelectionBoxes
from instdrive_app.session.versioned_cache import VersionedCache
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.edits.kinds.hide_rows import HideRows
from instdrive_core.edits.kinds.select import SelectInstances, SelectMode, SelectNone
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.region import find_ids_with_share
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import format_count, phrase

SHARE = 0.25
"""Side of a box that is placed on no object, relative to its distance from the camera …"""
LEAST, MOST = 0.5, 50.0
"""… but so many metres at least and at most."""
ROOM = 1.1
"""How much larger than an object the box around it is."""
LARGEST_OBJECT = 20.0
"""Metres: larger objects, such as the road, get no box around them unless they are farther away than that."""


@dataclass(frozen=True)
class _Crop:
    """One step that has changed what is cropped away."""

    edit: Edit
    rows: Int64[ndarray, " m"]
    """What it has left hidden."""


class BoxController:
    """Holds the box and what it crops away. Moving the box changes no document, but while it crops, what is shown."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self.box: Box | None = None
        """None until one is placed."""
        self._crops: list[_Crop] = []
        self._of: Document | None = None
        self._hidden: VersionedCache[Int64[ndarray, " m"]] = VersionedCache()
        self._gestures = count()
        self._gesture, self._base = "", np.zeros(0, np.int64)
        """The present drag, and what was cropped away when it began."""

    @property
    def is_cropping(self) -> bool:
        """Whether something is hidden because it is outside the box."""
        return len(self._find_cropped()) > 0

    def forget(self) -> None:
        """Forget the box, since another document is open."""
        self.box, self._of = None, None
        self._crops.clear()

    def place(self, place: Float[ndarray, "3"], distance: float, instance: int) -> None:
        """Put the box around an instance, or a new one at a place (metres) so far from the camera; 0 = no instance.

        A box that is there already keeps its size where no instance is meant.
        """
        document = self._context.document
        if document is None:
            return
        around = None
        if instance:
            around = SelectionBoxes().find_box(document, (instance,), self._context.state.time)
        if around is not None and float(around.size.max()) <= max(LARGEST_OBJECT, distance):
            box = Box(around.center, around.axes, np.maximum(around.size * ROOM, LEAST / 2))
        elif self.box is not None:
            box = Box(np.asarray(place, np.float64), self.box.axes, self.box.size)
        else:
            side = float(np.clip(SHARE * distance, LEAST, MOST))
            box = Box(np.asarray(place, np.float64), np.eye(3), np.full(3, side))
        self.begin_drag()
        self.change(box)

    def begin_drag(self) -> None:
        """Make what follows until the next call one step of the history, where the box crops."""
        self._gesture, self._base = f"box {next(self._gestures)}", self._find_cropped()

    def change(self, box: Box) -> None:
        """Give the box another shape or place; while it crops, show what is inside now."""
        self.box = box
        if self.is_cropping:
            self._crop()

    def turn(self, degrees: float) -> None:
        """Turn the box about the vertical."""
        if self.box is not None:
            self.begin_drag()
            self.change(turn_box(self.box, degrees))

    def remove(self) -> None:
        """Remove the box, and show again what it has hidden."""
        if self.is_cropping:
            self._uncrop()
        self.box = None

    def select(self, mode: SelectMode = "replace") -> None:
        """Select what is shown inside: single splats, or the instances of which most is inside."""
        document = self._context.document
        if document is None or self.box is None:
            return
        inside, shown = self._find_inside(document)
        inside &= shown
        if self._context.state.region_splats:
            self._context.apply(lambda: SelectRows(np.flatnonzero(inside), mode))
            self._tell(int(inside.sum()), "splat")
            return
        ids = document.scene.instance_ids
        found = find_ids_with_share(ids[inside], ids[shown])
        self._select_instances(found, mode)
        self._tell(len(found), "instance")

    def select_outside(self) -> None:
        """Select every splat that is shown outside."""
        document = self._context.document
        if document is not None and self.box is not None:
            inside, shown = self._find_inside(document)
            outside = np.flatnonzero(shown & ~inside)
            self._context.apply(lambda: SelectRows(outside))
            self._context.messages.info(
                phrase("{splats} outside the box selected", splats=format_count(len(outside), "splat"))
            )

    def delete_outside(self) -> None:
        """Delete what is outside, also what is hidden there because the box crops; locked splats are spared."""
        document = self._context.document
        if document is None or self.box is None:
            return
        inside, shown = self._find_inside(document)
        shown[self._find_cropped()] = True
        outside = np.flatnonzero(shown & ~inside)
        spared = outside[(document.state.flags[outside] & Flag.LOCKED) != 0]
        deleted = np.setdiff1d(outside, spared, assume_unique=True)
        if not len(deleted):
            self._context.messages.info("Nothing that can be deleted is outside the box")
            return
        back = np.setdiff1d(self._find_cropped(), deleted, assume_unique=True)
        title = phrase("Delete {splats} outside the box", splats=format_count(len(deleted), "splat"))
        parts: tuple[Edit, ...] = (DeleteRows(deleted), *((HideRows(back, hidden=False),) if len(back) else ()))
        if self._context.apply(lambda: CompoundEdit(parts, title)):
            gone, kept = format_count(len(deleted), "splat"), format_count(len(spared), "locked splat")
            told = phrase("{splats} outside the box deleted", splats=gone)
            if len(spared):
                told = phrase("{splats} outside the box deleted; {kept} spared", splats=gone, kept=kept)
            self._context.messages.info(told)
            self._context.state.hovered = 0

    def toggle_crop(self) -> None:
        """Show only what is inside the box, or everything again that was shown before."""
        if self.is_cropping:
            self._uncrop()
        elif self.box is not None:
            self.begin_drag()
            self._crop()
            if not self.is_cropping:
                self._context.messages.info("Nothing that is shown lies outside the box")

    def _crop(self) -> None:
        document = self._context.document
        if document is None:
            return
        before = self._find_cropped()
        inside, shown = self._find_inside(document)
        shown[before] = True
        rows = np.flatnonzero(shown & ~inside)
        # A further edit of the same drag finds the document as it was before the drag.
        back = np.setdiff1d(np.union1d(before, self._base), rows, assume_unique=True)
        parts: list[Edit] = [HideRows(back, hidden=False)] if len(back) else []
        parts += [HideRows(rows)] if len(rows) else []
        if not parts:
            return
        edit = CompoundEdit(tuple(parts), "Crop to the box")
        if self._context.apply(edit, self._gesture or None):
            self._note(document, edit, rows)

    def _uncrop(self) -> None:
        document, rows = self._context.document, self._find_cropped()
        edit = CompoundEdit((HideRows(rows, hidden=False),), "Show what was cropped away")
        if document is not None and self._context.apply(edit):
            self._note(document, edit, np.zeros(0, np.int64))

    def _note(self, document: Document, edit: Edit, rows: Int64[ndarray, " m"]) -> None:
        if document is not self._of:
            self._crops, self._of = [], document
        kept = {id(known) for known in document.history.edits}
        self._crops = [crop for crop in self._crops if id(crop.edit) in kept]
        self._crops.append(_Crop(edit, rows))

    def _find_cropped(self) -> Int64[ndarray, " m"]:
        """Rows that are hidden because they were outside, as the history stands."""
        document = self._context.document
        if document is None or document is not self._of or not self._crops:
            return np.zeros(0, np.int64)

        def find() -> Int64[ndarray, " m"]:
            done = {id(edit) for edit in document.history.done}
            rows = next((crop.rows for crop in reversed(self._crops) if id(crop.edit) in done), np.zeros(0, np.int64))
            flags = document.state.flags[rows]
            return rows[(flags & (Flag.HIDDEN | Flag.DELETED)) == Flag.HIDDEN]

        key = (document.versions.states, document.history.cursor, len(self._crops), id(self._crops[-1]))
        return self._hidden.get(document, key, find)

    def _find_inside(self, document: Document) -> tuple[Bool[ndarray, " n"], Bool[ndarray, " n"]]:
        """Whether each splat is inside the box, and whether it is shown."""
        assert self.box is not None
        means, shown = compute_shown_means(document, self._context.state.time)
        return find_inside(self.box, means), shown

    def _select_instances(self, ids: tuple[int, ...], mode: SelectMode) -> None:
        if ids:
            self._context.apply(lambda: SelectInstances(ids, mode))
        elif mode in ("replace", "intersect"):
            self._context.apply(SelectNone)

    def _tell(self, found: int, what: str) -> None:
        if found:
            self._context.messages.info(phrase("{found} inside the box", found=_count_found(found, what)))
        elif what == "instance":
            self._context.messages.info("No instance lies mostly inside the box; try single splats")
        else:
            self._context.messages.info("No splat that is shown lies inside the box")


def _count_found(count: int, what: str) -> str:
    return format_count(count, "instance") if what == "instance" else format_count(count, "splat")
