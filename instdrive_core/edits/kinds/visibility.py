"""Hiding, showing and locking instances. What is hidden or locked leaves the selection."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from numpy import ndarray

from instdrive_core.edits.bases.flags import FlagChange, FlagEdit
from instdrive_core.edits.bases.parameters import check_ids, check_switch
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.scene.selection import Flag, SplatState
from instdrive_core.wording import phrase


@dataclass
class HideInstances(FlagEdit):
    """Hide instances, or show them again with ``hidden=False``. Hidden splats are still exported."""

    kind: ClassVar[str] = "hide_instances"
    ids: tuple[int, ...]
    hidden: bool = True

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        check_switch(self.hidden, "hidden")

    @property
    def title(self) -> str:
        """``Hide instance 17``."""
        objects = describe_ids(self.ids)
        return phrase("Hide {objects}", objects=objects) if self.hidden else phrase("Show {objects}", objects=objects)

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Set or clear the bit on rows that are not deleted."""
        return _plan_flag_changes(document.state, document.find_rows(self.ids), Flag.HIDDEN, self.hidden)


@dataclass
class LockInstances(FlagEdit):
    """Protect instances from selection, deletion and recolouring, or free them with ``locked=False``."""

    kind: ClassVar[str] = "lock_instances"
    ids: tuple[int, ...]
    locked: bool = True

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        check_switch(self.locked, "locked")

    @property
    def title(self) -> str:
        """``Lock instance 17``."""
        objects = describe_ids(self.ids)
        return phrase("Lock {objects}", objects=objects) if self.locked else phrase("Unlock {objects}", objects=objects)

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Set or clear the bit on rows that are not deleted."""
        return _plan_flag_changes(document.state, document.find_rows(self.ids), Flag.LOCKED, self.locked)


@dataclass
class ShowAll(FlagEdit):
    """Show everything that is hidden."""

    kind: ClassVar[str] = "show_all"

    @property
    def title(self) -> str:
        """``Show all``."""
        return "Show all"

    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """Clear the bit wherever it is set."""
        yield FlagChange(document.state.find_rows(Flag.HIDDEN), Flag.HIDDEN, False)


def _plan_flag_changes(state: SplatState, rows: ndarray, flag: Flag, on: bool) -> Iterator[FlagChange]:
    alive = rows[(state.flags[rows] & Flag.DELETED) == 0]
    if on:
        yield FlagChange(alive, Flag.SELECTED, False)
    yield FlagChange(alive, flag, on)
