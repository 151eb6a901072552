"""Selecting splats: by instance, by codeword, none. Hidden, locked and deleted splats are never selected."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from numpy import ndarray

from instdrive_core.edits.base import checked_ids, counted
from instdrive_core.edits.document import Document
from instdrive_core.edits.flags import FlagChange, FlagEdit, selectable
from instdrive_core.errors import EditError
from instdrive_core.instances.codebook import MAX_BITS
from instdrive_core.scene.selection import Flag, SplatState

SelectMode = Literal["replace", "add", "remove"]
_VERBS = {"replace": "Select", "add": "Add to selection:", "remove": "Deselect"}


@dataclass
class SelectInstances(FlagEdit):
    """Select whole instances, or add them to or remove them from the selection."""

    kind: ClassVar[str] = "select_instances"
    ids: tuple[int, ...]
    mode: SelectMode = "replace"

    def __post_init__(self) -> None:
        self.ids = checked_ids(self.ids)
        _check_mode(self.mode)

    @property
    def title(self) -> str:
        """``Select instance 17``."""
        return f"{_VERBS[self.mode]} {counted(self.ids)}"

    def changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear the selection where it is replaced, then set or clear the instances' rows."""
        return _selection_changes(document.state, document.rows_of(self.ids), self.mode)


@dataclass
class SelectCodeword(FlagEdit):
    """Select all splats of a codeword, across instances (the paper's selection)."""

    kind: ClassVar[str] = "select_codeword"
    codeword: int
    mode: SelectMode = "replace"

    def __post_init__(self) -> None:
        whole = isinstance(self.codeword, int) and not isinstance(self.codeword, bool)
        if not whole or not 0 <= self.codeword < 1 << MAX_BITS:
            raise EditError(f"codeword {self.codeword!r} is not a whole number of at most {MAX_BITS} bits")
        _check_mode(self.mode)

    @property
    def title(self) -> str:
        """``Select codeword 1038``."""
        return f"{_VERBS[self.mode]} codeword {self.codeword}"

    def changes(self, document: Document) -> Iterator[FlagChange]:
        """As `SelectInstances`, for the codeword's rows."""
        rows = document.rows_of_codeword(self.codeword)
        if not len(rows):
            raise EditError(f"no splat of the scene has codeword {self.codeword}")
        return _selection_changes(document.state, rows, self.mode)


@dataclass
class SelectNone(FlagEdit):
    """Clear the selection."""

    kind: ClassVar[str] = "select_none"

    @property
    def title(self) -> str:
        """``Clear selection``."""
        return "Clear selection"

    def changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear all selected rows."""
        yield FlagChange(document.state.rows_with(Flag.SELECTED), Flag.SELECTED, False)


def _selection_changes(state: SplatState, rows: ndarray, mode: SelectMode) -> Iterator[FlagChange]:
    if mode == "remove":
        yield FlagChange(rows, Flag.SELECTED, False)
        return
    targets = selectable(state, rows)
    if mode == "replace":
        # Rows that stay selected are left alone: the delta holds only what changes.
        keep = state.mask(Flag.SELECTED)
        keep[targets] = False
        yield FlagChange(keep.nonzero()[0], Flag.SELECTED, False)
    yield FlagChange(targets, Flag.SELECTED, True)


def _check_mode(mode: str) -> None:
    if mode not in get_args(SelectMode):
        raise EditError(f"selection mode {mode!r} is not one of {', '.join(get_args(SelectMode))}")
