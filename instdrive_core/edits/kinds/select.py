"""Selecting by what the scene knows: instances, classes, codewords, everything, nothing, and the inverse."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy import ndarray

from instdrive_core.edits.bases.flags import FlagChange, FlagEdit, keep_selectable
from instdrive_core.edits.bases.parameters import check_ids, is_whole
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.errors import EditError
from instdrive_core.instances.codebook import MAX_BITS
from instdrive_core.scene.selection import Flag, SplatState
from instdrive_core.wording import Phrase, phrase

SelectMode = Literal["replace", "add", "remove", "intersect"]
_TITLES: dict[SelectMode, str] = {
    "replace": "Select {what}",
    "add": "Add to selection: {what}",
    "remove": "Deselect {what}",
    "intersect": "Select only what is in {what}",
}


def title_selection(mode: SelectMode, what: str) -> Phrase:
    """The title of an edit that selects something, e.g. ``Deselect instance 17``."""
    return phrase(_TITLES[mode], what=what)


@dataclass
class SelectInstances(FlagEdit):
    """Select whole instances, or add them to or remove them from the selection."""

    kind: ClassVar[str] = "select_instances"
    selects_only: ClassVar[bool] = True
    ids: tuple[int, ...]
    mode: SelectMode = "replace"

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        check_mode(self.mode)

    @property
    def title(self) -> str:
        """``Select instance 17``."""
        return title_selection(self.mode, describe_ids(self.ids))

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear the selection where it is replaced, then set or clear the instances' rows."""
        return plan_selection_changes(document.state, document.find_rows(self.ids), self.mode)


@dataclass
class SelectClass(FlagEdit):
    """Select all instances of a class."""

    kind: ClassVar[str] = "select_class"
    selects_only: ClassVar[bool] = True
    class_name: str
    """Class in the instance table; empty = the instances that have none."""
    mode: SelectMode = "replace"

    def __post_init__(self) -> None:
        if not isinstance(self.class_name, str):
            raise EditError(phrase("class name {class_name!r} is no text", class_name=self.class_name))
        check_mode(self.mode)

    @property
    def title(self) -> str:
        """``Select class Car``."""
        name = phrase("class {name}", name=self.class_name) if self.class_name else phrase("class none")
        return title_selection(self.mode, name)

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear the selection where it is replaced, then set or clear the rows of the class."""
        table = document.scene.table
        ids = tuple(instance.id for instance in table if instance.class_name == self.class_name)
        if not ids:
            known = ", ".join(sorted({instance.class_name for instance in table} - {""})) or "none"
            raise EditError(
                phrase(
                    "no instance has the class {class_name!r}; the scene's classes are: {known}",
                    class_name=self.class_name,
                    known=known,
                )
            )
        return plan_selection_changes(document.state, document.find_rows(ids), self.mode)


@dataclass
class SelectCodeword(FlagEdit):
    """Select all splats of a codeword, across instances (the paper's selection)."""

    kind: ClassVar[str] = "select_codeword"
    selects_only: ClassVar[bool] = True
    codeword: int
    mode: SelectMode = "replace"

    def __post_init__(self) -> None:
        if not is_whole(self.codeword) or not 0 <= self.codeword < 1 << MAX_BITS:
            raise EditError(
                phrase(
                    "codeword {codeword!r} is not a whole number of at most {most} bits",
                    codeword=self.codeword,
                    most=MAX_BITS,
                )
            )
        check_mode(self.mode)

    @property
    def title(self) -> str:
        """``Select codeword 1038``."""
        return title_selection(self.mode, phrase("codeword {codeword}", codeword=self.codeword))

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear the selection where it is replaced, then set or clear the codeword's rows."""
        rows = document.find_codeword_rows(self.codeword)
        if not len(rows):
            raise EditError(phrase("no splat of the scene has codeword {codeword}", codeword=self.codeword))
        return plan_selection_changes(document.state, rows, self.mode)


@dataclass
class SelectAll(FlagEdit):
    """Select every splat that is not hidden, locked or deleted."""

    kind: ClassVar[str] = "select_all"
    selects_only: ClassVar[bool] = True

    @property
    def title(self) -> str:
        """``Select all``."""
        return "Select all"

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Set the bit wherever it may be set and is not."""
        yield FlagChange(_find_free_rows(document.state), Flag.SELECTED, True)


@dataclass
class InvertSelection(FlagEdit):
    """Select what is not selected, of what is not hidden, locked or deleted, and nothing else."""

    kind: ClassVar[str] = "invert_selection"
    selects_only: ClassVar[bool] = True

    @property
    def title(self) -> str:
        """``Invert selection``."""
        return "Invert selection"

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Swap the two sets."""
        selected, others = document.state.find_rows(Flag.SELECTED), _find_free_rows(document.state)
        yield FlagChange(selected, Flag.SELECTED, False)
        yield FlagChange(others, Flag.SELECTED, True)


@dataclass
class SelectNone(FlagEdit):
    """Clear the selection."""

    kind: ClassVar[str] = "select_none"
    selects_only: ClassVar[bool] = True

    @property
    def title(self) -> str:
        """``Clear selection``."""
        return "Clear selection"

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear all selected rows."""
        yield FlagChange(document.state.find_rows(Flag.SELECTED), Flag.SELECTED, False)


def plan_selection_changes(state: SplatState, rows: ndarray, mode: SelectMode) -> Iterator[FlagChange]:
    """The flag changes of a select edit that found `rows` (m,), by its mode."""
    if mode == "remove":
        yield FlagChange(rows, Flag.SELECTED, False)
        return
    if mode in ("replace", "intersect"):
        # Rows that stay selected are left alone: the delta holds only what changes.
        outside = state.find_mask(Flag.SELECTED)
        outside[rows] = False
        yield FlagChange(outside.nonzero()[0], Flag.SELECTED, False)
    if mode != "intersect":
        yield FlagChange(keep_selectable(state, rows), Flag.SELECTED, True)


def check_mode(mode: str) -> None:
    """Raise EditError where `mode` is no `SelectMode`."""
    if mode not in get_args(SelectMode):
        raise EditError(
            phrase("selection mode {mode!r} is not one of {list}", mode=mode, list=", ".join(get_args(SelectMode)))
        )


def _find_free_rows(state: SplatState) -> ndarray:
    """Rows without any bit: not selected, and free to be."""
    return np.flatnonzero(state.flags == 0)
