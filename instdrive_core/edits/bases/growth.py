"""The base class of edits that add splats no photo shows to an instance, in place of others of it."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.edits.bases.append import AppendEdit
from instdrive_core.edits.bases.editable import check_unlocked
from instdrive_core.edits.bases.flags import FlagChange
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.synthetic_rows import SYNTHETIC, find_shadow
from instdrive_core.errors import EditError
from instdrive_core.maths.vectors import Vector
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase


@dataclass
class GrowInstance(AppendEdit):
    """Subclasses say what is added and what it replaces; what is added is selected where the instance is."""

    id: int
    _flags_done: tuple[FlagChange, ...] = field(default=(), init=False, repr=False, compare=False)
    _new_column: bool = field(default=False, init=False, repr=False, compare=False)

    @property
    def shift(self) -> Vector:
        """No shift: everything is added where the instance is."""
        return (0.0, 0.0, 0.0)

    @abstractmethod
    def find_replaced(self, document: Document) -> Int64[ndarray, " k"]:
        """Rows of the instance that are deleted."""

    def do(self, document: Document) -> bool:
        """Add the splats and delete those that they replace."""
        if self.id not in document.scene.table:
            raise EditError(phrase("there is no instance {id}", id=self.id))
        check_unlocked(document, (self.id,))
        self._new_column = SYNTHETIC not in document.scene.extra
        if self._new_column:
            document.scene.extra[SYNTHETIC] = np.zeros(len(document.scene), np.uint8)
        try:
            replaced = self.find_replaced(document)
            super().do(document)
        except Exception:
            self._drop_column(document)
            raise
        flag_like_others(document, self.id, self._count)
        self._flags_done = tuple(
            FlagChange(document.state.change(replaced, flag, on).astype(np.int32), flag, on)
            for flag, on in ((Flag.SELECTED, False), (Flag.DELETED, True))
        )
        return True

    def undo(self, document: Document) -> None:
        """Take away what was added, and bring back what it replaced."""
        for change in reversed(self._flags_done):
            document.state.change(change.rows, change.flag, not change.on)
        super().undo(document)
        self._drop_column(document)

    def _drop_column(self, document: Document) -> None:
        if self._new_column:
            del document.scene.extra[SYNTHETIC]
            self._new_column = False


def flag_like_others(document: Document, number: int, count: int) -> None:
    """Select and hide what was added to an instance, among the last `count` rows, where all the rest of it is."""
    rows = document.find_rows((number,))
    place = int(np.searchsorted(rows, len(document.scene) - count))
    flags = document.state.flags[rows[:place]]
    shared = int(np.bitwise_and.reduce(flags[(flags & Flag.DELETED) == 0], initial=255))
    for flag in (Flag.SELECTED, Flag.HIDDEN):
        if shared & flag:
            document.state.change(rows[place:], flag, True)


def find_shown_body(document: Document, number: int) -> Int64[ndarray, " k"]:
    """Find the rows of an instance's main node that are neither deleted nor hidden, without its shadow.

    Raises EditError where nothing is left.
    """
    rows = document.find_rows((number,))
    alive = (document.state.flags[rows] & (Flag.DELETED | Flag.HIDDEN)) == 0
    alive &= document.scene.nodes[rows] == document.scene.table[number].node
    rows = rows[alive & ~find_shadow(document, rows)]
    if not len(rows):
        raise EditError(phrase("nothing is left of instance {id}", id=number))
    return rows


def find_main_entry(document: Document, rows: Int64[ndarray, " k"]) -> int:
    """Find the entry of the transform palette that most of at least one row have."""
    return int(np.bincount(document.transforms.indices[rows]).argmax())
