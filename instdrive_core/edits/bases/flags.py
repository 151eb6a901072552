"""The base class of edits that only set or clear state bits."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.scene.selection import Flag, SplatState


class FlagChange(NamedTuple):
    """Set or clear one bit on some rows."""

    rows: ndarray
    flag: Flag
    on: bool


@dataclass
class FlagEdit(Edit):
    """An edit of state bits: subclasses say which, this class does, remembers and undoes."""

    _done: list[FlagChange] = field(default_factory=list, init=False, repr=False, compare=False)

    @abstractmethod
    def plan_changes(self, document: Document) -> Iterator[FlagChange]:
        """The changes in order, each seeing those before it. Raises EditError before the first one."""

    def do(self, document: Document) -> bool:
        """Apply the changes; keeps the rows that really changed."""
        done = []
        for rows, flag, on in self.plan_changes(document):
            changed = document.state.change(rows, flag, on)
            if len(changed):
                done.append(FlagChange(changed.astype(np.int32), flag, on))
        self._done = done
        return bool(done)

    def list_set_rows(self, flag: Flag) -> ndarray:
        """List the rows on which doing this edit has set a bit."""
        rows = [change.rows for change in self._done if change.on and change.flag & flag]
        return np.concatenate([np.zeros(0, np.int32), *rows]).astype(np.int64)

    def undo(self, document: Document) -> None:
        """Flip back, in reverse order, the bits that changed."""
        for rows, flag, on in reversed(self._done):
            document.state.change(rows, flag, not on)


def keep_selectable(state: SplatState, rows: ndarray) -> ndarray:
    """Keep the rows that can be selected: neither hidden, locked nor deleted."""
    return rows[(state.flags[rows] & (Flag.HIDDEN | Flag.LOCKED | Flag.DELETED)) == 0]
