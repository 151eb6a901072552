"""Selecting any splats: what region tools and filters found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

from jaxtyping import Int
from numpy import ndarray

from instdrive_core.edits.bases.flags import FlagChange, FlagEdit
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.row_runs import RowRuns, expand_runs, make_runs
from instdrive_core.edits.kinds.select import SelectMode, check_mode, plan_selection_changes, title_selection
from instdrive_core.wording import format_count


@dataclass
class SelectRows(FlagEdit):
    """Select splats by their rows; those that are hidden, locked or deleted are passed over."""

    kind: ClassVar[str] = "select_rows"
    selects_only: ClassVar[bool] = True
    rows: RowRuns | Int[ndarray, " m"] | Sequence[object]
    """Row numbers as an array, or runs as pairs (first row, number of rows); kept as runs."""
    mode: SelectMode = "replace"

    def __post_init__(self) -> None:
        self.rows = make_runs(self.rows)
        check_mode(self.mode)

    @property
    def title(self) -> str:
        """``Select 1,204 splats``."""
        return title_selection(self.mode, format_count(len(make_runs(self.rows)), "splat"))

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear the selection where it is replaced, then set or clear the rows."""
        rows = expand_runs(make_runs(self.rows), len(document.scene))
        return plan_selection_changes(document.state, rows, self.mode)

    def to_json(self) -> dict[str, object]:
        """Kind and parameters, with the rows as runs."""
        return {"kind": self.kind, "rows": make_runs(self.rows).to_json(), "mode": self.mode}
