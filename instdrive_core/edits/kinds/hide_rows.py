"""Hiding or showing any splats, as a crop does: what is hidden leaves the selection, and is still exported."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

from jaxtyping import Int
from numpy import ndarray

from instdrive_core.edits.bases.flags import FlagChange, FlagEdit
from instdrive_core.edits.bases.parameters import check_switch
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.row_runs import RowRuns, expand_runs, make_runs
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import format_count, phrase


@dataclass
class HideRows(FlagEdit):
    """Hide splats by their rows, or show them again with ``hidden=False``; deleted ones are passed over."""

    kind: ClassVar[str] = "hide_rows"
    rows: RowRuns | Int[ndarray, " m"] | Sequence[object]
    """Row numbers as an array, or runs as pairs (first row, number of rows); kept as runs."""
    hidden: bool = True

    def __post_init__(self) -> None:
        self.rows = make_runs(self.rows)
        check_switch(self.hidden, "hidden")

    @property
    def title(self) -> str:
        """``Hide 1,204 splats``."""
        objects = format_count(len(make_runs(self.rows)), "splat")
        return phrase("Hide {objects}", objects=objects) if self.hidden else phrase("Show {objects}", objects=objects)

    def to_json(self) -> dict[str, object]:
        """Kind and parameters, with the rows as runs."""
        return {"kind": self.kind, "rows": make_runs(self.rows).to_json(), "hidden": self.hidden}

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Set or clear the bit. Raises EditError for rows that the scene does not have."""
        rows = expand_runs(make_runs(self.rows), len(document.scene))
        alive = rows[(document.state.flags[rows] & Flag.DELETED) == 0]
        if self.hidden:
            yield FlagChange(alive, Flag.SELECTED, False)
        yield FlagChange(alive, Flag.HIDDEN, self.hidden)
