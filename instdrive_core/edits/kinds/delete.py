"""Deleting splats: a flag, dropped at export. Locked splats are spared."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

from jaxtyping import Int
from numpy import ndarray

from instdrive_core.edits.bases.editable import find_editable_rows
from instdrive_core.edits.bases.flags import FlagChange, FlagEdit
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.edits.document.row_runs import RowRuns, expand_runs, make_runs
from instdrive_core.errors import EditError
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import format_count, phrase


@dataclass
class DeleteInstances(FlagEdit):
    """Delete whole instances; an actor is deleted at all times."""

    kind: ClassVar[str] = "delete_instances"
    ids: tuple[int, ...]

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)

    @property
    def title(self) -> str:
        """``Delete instance 17``."""
        return phrase("Delete {objects}", objects=describe_ids(self.ids))

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Deselect and delete the instances' rows."""
        rows = find_editable_rows(document, self.ids)
        return _plan_deletion(rows)


@dataclass
class DeleteSelected(FlagEdit):
    """Delete the selected splats."""

    kind: ClassVar[str] = "delete_selected"

    @property
    def title(self) -> str:
        """``Delete selection``."""
        return "Delete selection"

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Deselect and delete the selected rows."""
        rows = document.state.find_rows(Flag.SELECTED)
        if not len(rows):
            raise EditError("nothing is selected; select what to delete first")
        return _plan_deletion(rows)


@dataclass
class DeleteRows(FlagEdit):
    """Delete any splats, e.g. those that the linter objects to; locked ones are spared."""

    kind: ClassVar[str] = "delete_rows"
    rows: RowRuns | Int[ndarray, " m"] | Sequence[object]
    """Row numbers as an array, or runs as pairs (first row, number of rows); kept as runs."""

    def __post_init__(self) -> None:
        self.rows = make_runs(self.rows)

    @property
    def title(self) -> str:
        """``Delete 12 splats``."""
        return phrase("Delete {splats}", splats=format_count(len(make_runs(self.rows)), "splat"))

    def to_json(self) -> dict[str, object]:
        """The rows as runs."""
        return {"kind": self.kind, "rows": make_runs(self.rows).to_json()}

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Deselect and delete the rows. Raises EditError for rows that the scene does not have."""
        rows = expand_runs(make_runs(self.rows), len(document.scene))
        return _plan_deletion(rows[(document.state.flags[rows] & (Flag.DELETED | Flag.LOCKED)) == 0])


def _plan_deletion(rows: ndarray) -> Iterator[FlagChange]:
    yield FlagChange(rows, Flag.SELECTED, False)
    yield FlagChange(rows, Flag.DELETED, True)
