"""Deleting splats: a flag, dropped at export. Locked splats are spared."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from instdrive_core.edits.base import ids_in_words
from instdrive_core.edits.document import Document
from instdrive_core.edits.flags import FlagChange, FlagEdit
from instdrive_core.edits.parameters import checked_ids
from instdrive_core.edits.row_kernels import free_rows
from instdrive_core.edits.row_parts import RowParts
from instdrive_core.edits.row_runs import RowRuns, row_runs, rows_of_scene
from instdrive_core.errors import EditError
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import counted


@dataclass
class DeleteInstances(FlagEdit):
    """Delete whole instances; an actor is deleted at all times."""

    kind: ClassVar[str] = "delete_instances"
    ids: tuple[int, ...]

    def __post_init__(self) -> None:
        self.ids = checked_ids(self.ids)

    @property
    def title(self) -> str:
        """``Delete instance 17``."""
        return f"Delete {ids_in_words(self.ids)}"

    def changes(self, document: Document) -> Iterator[FlagChange]:
        """Deselect and delete the instances' rows."""
        rows = editable(document, self.ids)
        return _deletion(rows)


@dataclass
class DeleteSelected(FlagEdit):
    """Delete the selected splats."""

    kind: ClassVar[str] = "delete_selected"

    @property
    def title(self) -> str:
        """``Delete selection``."""
        return "Delete selection"

    def changes(self, document: Document) -> Iterator[FlagChange]:
        """Deselect and delete the selected rows."""
        rows = document.state.rows_with(Flag.SELECTED)
        if not len(rows):
            raise EditError("nothing is selected; select what to delete first")
        return _deletion(rows)


@dataclass
class DeleteRows(FlagEdit):
    """Delete any splats, e.g. those that the linter objects to; locked ones are spared."""

    kind: ClassVar[str] = "delete_rows"
    rows: RowRuns | Int[ndarray, " m"] | tuple[Any, ...] | list[Any]
    """Row numbers as an array, or runs as pairs (first row, number of rows); kept as runs."""

    def __post_init__(self) -> None:
        self.rows = row_runs(self.rows)

    @property
    def title(self) -> str:
        """``Delete 12 splats``."""
        return f"Delete {counted(len(row_runs(self.rows)), 'splat')}"

    def to_json(self) -> dict[str, Any]:
        """The rows as runs."""
        return {"kind": self.kind, "rows": row_runs(self.rows).to_json()}

    def changes(self, document: Document) -> Iterator[FlagChange]:
        """Deselect and delete the rows. Raises EditError for rows that the scene does not have."""
        rows = rows_of_scene(row_runs(self.rows), len(document.scene))
        return _deletion(rows[(document.state.flags[rows] & (Flag.DELETED | Flag.LOCKED)) == 0])


def editable(document: Document, ids: tuple[int, ...]) -> ndarray:
    """Rows of the instances that are neither deleted nor locked. Raises EditError where none is left."""
    rows = document.rows_of(ids)
    flags = document.state.flags[rows]
    free = rows[(flags & (Flag.DELETED | Flag.LOCKED)) == 0]
    if not len(free):
        raise _not_editable(ids, bool(((flags & Flag.LOCKED) != 0).any()))
    return free


def editable_parts(document: Document, ids: tuple[int, ...]) -> RowParts:
    """The same for each of the instances. Raises EditError where one has none left."""
    parts, flags = document.row_parts(ids), document.state.flags
    free = RowParts(*free_rows(parts.rows, parts.bounds, flags, np.uint8(Flag.DELETED | Flag.LOCKED)))
    none_left = np.flatnonzero(free.sizes == 0)
    if len(none_left):
        first = int(none_left[0])
        rows = parts.rows[parts.bounds[first] : parts.bounds[first + 1]]
        raise _not_editable(ids[first : first + 1], bool(((flags[rows] & Flag.LOCKED) != 0).any()))
    return free


def _not_editable(ids: tuple[int, ...], locked: bool) -> EditError:
    reason = "locked; unlock it first" if locked else "deleted already"
    return EditError(f"{ids_in_words(ids)}: every splat is {reason}")


def check_unlocked(document: Document, ids: Iterable[int]) -> None:
    """Raises EditError where any of these instances is locked: its name, class and splats are not to change."""
    wanted = tuple(ids)
    parts = document.row_parts(wanted)
    states = document.state.flags[parts.rows] & np.uint8(Flag.DELETED | Flag.LOCKED)
    locked = np.flatnonzero(states == Flag.LOCKED)
    if len(locked):
        instance_id = wanted[int(np.searchsorted(parts.bounds, locked[0], side="right")) - 1]
        raise EditError(f"instance {instance_id} is locked; unlock it first")


def _deletion(rows: ndarray) -> Iterator[FlagChange]:
    yield FlagChange(rows, Flag.SELECTED, False)
    yield FlagChange(rows, Flag.DELETED, True)
