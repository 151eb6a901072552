"""Walking through a list by keys: which row comes next, and what is selected then."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

Step = Literal["up", "down", "first", "last"]


@dataclass(frozen=True)
class Walk:
    """The range selected by keys in a list of instances; 0 means nowhere yet."""

    anchor: int = 0
    """The end of the range that stays."""
    cursor: int = 0
    """The end that moves."""

    def advance(self, step: Step, extends: bool, ids: Sequence[int], may_stop: Callable[[int], bool]) -> Walk:
        """The walk after one key; `extends` keeps the anchor.

        The cursor stays if it may stop at no further row. A cursor that is in no row goes to the first row, or to the
        last one if the step leads upwards.
        """
        row = ids.index(self.cursor) if self.cursor in ids else None
        last = len(ids) - 1
        if step == "first" or (step == "down" and row is None):
            path = range(len(ids))
        elif step == "last" or row is None:
            path = range(last, -1, -1)
        else:
            path = range(row + 1, len(ids)) if step == "down" else range(row - 1, -1, -1)
        cursor = next((ids[place] for place in path if may_stop(ids[place])), self.cursor)
        return Walk(self.anchor if extends and self.anchor in ids else cursor, cursor)

    def list_range(self, ids: Sequence[int]) -> tuple[int, ...]:
        """List the instances from one end to the other, in the list's order; both ends must be in the list."""
        first, last = sorted((ids.index(self.anchor), ids.index(self.cursor)))
        return tuple(ids[first : last + 1])
