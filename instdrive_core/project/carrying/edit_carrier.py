"""Edits of one document made for another, whose rows are those of the first and what grew from them.

Both documents are edited side by side. Edits that name rows get those that came of them. Edits that look at splats to
find out what they do (label repairs, grown selections, where something is put down) get what they found on the old
document, so that they do the same again. What they add (fills, shadows, copies) is made anew of the better splats.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from instdrive_core.edits.bases.body_color import find_body_color
from instdrive_core.edits.bases.editable import find_colorable_parts
from instdrive_core.edits.bases.relabel import RelabelEdit
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.row_runs import RowRuns, make_runs
from instdrive_core.edits.kinds.absorb import AbsorbFloaters
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.edits.kinds.find_objects import FindObjects
from instdrive_core.edits.kinds.grow import BorderEdit
from instdrive_core.edits.kinds.hide_rows import HideRows
from instdrive_core.edits.kinds.labels.relabel_rows import RelabelRows
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.paint import PaintInstances
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.kinds.shape.complete import CompleteInstance
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.edits.queries.placement import compute_center
from instdrive_core.errors import DataError, EditError
from instdrive_core.project.carrying.row_origins import RowOrigins
from instdrive_core.scene.selection import Flag

_ONE, _MANY = ("id", "into", "like"), ("ids", "behind", "beside")
"""Parameters of edits that name an instance, or several."""


class EditCarrier:
    """Takes edits over, one after the other, from the first one of a history on.

    Args:
        old: the document that the edits were made for, without any.
        new: the other one, without any.
        origins: rows of `old` by rows of `new`.
    """

    def __init__(self, old: Document, new: Document, origins: RowOrigins) -> None:
        self._old, self._new, self._origins = old, new, origins
        self._names: dict[int, int | None] = {}
        """New IDs of instances that edits made, where they differ; None = the new document has no such instance."""
        self.left_out: list[str] = []
        """A sentence for each edit that could not be done again."""

    def carry(self, edit: Edit) -> Edit | None:
        """Do an edit on both documents; returns that of the new one, None where nothing is left of it there."""
        if not isinstance(edit, CompoundEdit):
            return self._carry_single(edit)
        parts = [part for part in map(self.carry, edit.edits) if part is not None]
        return CompoundEdit(tuple(parts), edit.name) if parts else None

    def _carry_single(self, edit: Edit) -> Edit | None:
        old, new = self._old, self._new
        rows = len(old.scene), len(new.scene)
        free = old.first_free_id, new.first_free_id
        planned, done = self._plan(edit), edit.copy_undone()
        if not done.do(old):
            return None
        result = None
        try:
            result = self._settle(planned, done)
            if result is not None and not result.do(new):
                result = None
        except (EditError, DataError) as error:
            self.left_out.append(f"“{edit.title}” cannot be done on the improved scene ({error})")
            result = None
        self._origins.append(old.scene.gaussians.means[rows[0] :], new.scene.gaussians.means[rows[1] :])
        self._note_new_ids(range(free[0], old.first_free_id), range(free[1], new.first_free_id))
        return None if result is None else result.copy_undone()

    def _plan(self, edit: Edit) -> Edit:
        """What has to be known before the old document changes."""
        if isinstance(edit, MoveInstances):
            return _fix_move(edit, self._old)
        if isinstance(edit, PaintInstances) and edit.reference is None and len(edit.ids) == 1:
            (part,) = find_colorable_parts(self._old, edit.ids)
            red, green, blue = np.asarray(find_body_color(self._old.scene.gaussians, part)).tolist()
            return edit.copy_undone(reference=(red, green, blue))
        return edit

    def _settle(self, edit: Edit, done: Edit) -> Edit | None:
        """The edit for the new document, after `done` has changed the old one."""
        if isinstance(edit, SelectRows | DeleteRows | HideRows):
            rows = self._origins.spread(make_runs(edit.rows).rows)
            return edit.copy_undone(rows=RowRuns.from_rows(rows)) if len(rows) or isinstance(edit, SelectRows) else None
        if isinstance(edit, RelabelRows):
            parts = tuple(RowRuns.from_rows(self._origins.spread(make_runs(part).rows)) for part in edit.parts)
            return self._rename(edit.copy_undone(parts=parts))
        if isinstance(edit, CompleteInstance):
            names = ("kept", "known", "strays")
            runs = {
                name: RowRuns.from_rows(self._origins.spread(make_runs(getattr(edit, name)).rows)) for name in names
            }
            return self._rename(edit.copy_undone(**runs))
        if isinstance(edit, BorderEdit):
            rows = self._origins.spread(self._old.state.find_rows(Flag.SELECTED))
            return SelectRows(RowRuns.from_rows(rows)) if len(rows) else edit.copy_undone()
        if isinstance(edit, AbsorbFloaters | SplitInstance | FindObjects):
            return self._fix_relabeling(edit, done)
        return self._rename(edit)

    def _fix_relabeling(self, edit: AbsorbFloaters | SplitInstance | FindObjects, done: Edit) -> Edit:
        assert isinstance(done, RelabelEdit)
        rows = done.get_changed_rows()
        ids = self._old.scene.instance_ids[rows]
        targets, places = np.unique(ids, return_inverse=True)
        parts = tuple(RowRuns.from_rows(self._origins.spread(rows[places == k])) for k in range(len(targets)))
        if isinstance(edit, AbsorbFloaters):
            gone = self._old.summarize_instance(edit.id).is_deleted
            return self._rename(RelabelRows(edit.kind, parts, tuple(targets.tolist()), deletes=gone))
        like = edit.id if isinstance(edit, SplitInstance) else 0
        return self._rename(RelabelRows(edit.kind, parts, (None,) * len(parts), like))

    def _rename(self, edit: Edit) -> Edit:
        """The edit with the instances' IDs in the new document. Raises EditError where none of them is there."""
        changes: dict[str, Any] = {}
        for name in {entry.name for entry in fields(edit)} if self._names else ():  # type: ignore[arg-type]
            value = getattr(edit, name)
            if name in _ONE and isinstance(value, int) and value in self._names:
                changes[name] = self._find_name(value)
            elif name in _MANY and isinstance(value, tuple):
                known = [number for number in value if self._names.get(number, number) is not None]
                changes[name] = tuple(self._names.get(number, number) for number in known)
            elif name in _ONE and isinstance(value, tuple):
                changes[name] = tuple(number if number is None else self._find_name(number) for number in value)
        return edit.copy_undone(**changes)

    def _find_name(self, number: int) -> int:
        name = self._names.get(number, number)
        if name is None:
            raise EditError(f"instance {number} was not made there")
        return name

    def _note_new_ids(self, old: range, new: range) -> None:
        for place, number in enumerate(old):
            name = new[place] if place < len(new) else None
            if name != number:
                self._names[number] = name


def _fix_move(edit: MoveInstances, document: Document) -> MoveInstances:
    """Fix a move: where the middle, the lane and the ground were goes into its numbers."""
    matrix = edit.compute_matrix(document)
    pivot = edit.pivot if edit.pivot is not None else compute_center(document, edit.ids, edit.time).tolist()
    at = np.array(pivot)
    x, y, z = (matrix[:, 3] - at + matrix[:, :3] @ at).tolist()
    px, py, pz = at.tolist()
    return edit.copy_undone(pivot=(px, py, pz), translation=(x, y, z), along_lane=False, on_ground=False)
