"""Tables of a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from instdrive_core.evaluation.page.pictures import Picture

_UNKNOWN = -1e9
"""Order of unknown values: below all others."""


@dataclass(frozen=True)
class Cell:
    """One cell: a text, and what may stand around it."""

    text: str
    below: str = ""
    """Smaller line under the text."""
    picture: Picture | None = None
    color: str = ""
    """CSS colour of a swatch before the text; empty = no swatch."""
    order: float | None = None
    """Value that a number is sorted by; None in cells of text."""
    is_best: bool = False

    @property
    def is_number(self) -> bool:
        """Whether the cell is aligned to the right and sorted by value."""
        return self.order is not None


@dataclass(frozen=True)
class PageTable:
    """Rows of cells under the names of their columns."""

    columns: Sequence[str]
    """Empty: the table has no head."""
    rows: Sequence[Sequence[Cell]]
    kind: Literal["plain", "sortable", "facts"] = "plain"
    id: str = ""
    """Name by which a filter finds the table."""

    def is_numeric(self, column: int) -> bool:
        """Whether a column holds numbers, judged by the first row."""
        return bool(self.rows) and column < len(self.rows[0]) and self.rows[0][column].is_number


def build_number_cell(text: str, value: float | None = None, below: str = "", is_best: bool = False) -> Cell:
    """Build a right-aligned cell that is sorted by `value`; unknown values sort below all others."""
    return Cell(text, below, order=_UNKNOWN if value is None else value, is_best=is_best)


def build_fact_table(facts: Mapping[str, str]) -> PageTable:
    """Build a table of names and values without a head."""
    return PageTable((), [(Cell(name), Cell(value)) for name, value in facts.items()], "facts")
