"""Filling the holes of one deletion as one step, worked out before it is done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.fill_hole import FillHole
from instdrive_core.errors import EditError
from instdrive_core.progress import report_span
from instdrive_core.wording import phrase


@dataclass(frozen=True)
class PreparedFill:
    """Fills that know what to copy, in their order."""

    edit: Edit
    """All of them as one step."""
    fills: tuple[FillHole, ...]
    refused: tuple[EditError, ...]
    """Why others cannot be done."""

    @property
    def hole_count(self) -> int:
        """How many holes in the ground are filled; other fills close only what stands behind."""
        return sum(bool(fill.cells) for fill in self.fills)

    @property
    def area(self) -> float:
        """Square metres of ground."""
        return sum(fill.area for fill in self.fills)

    def is_prepared_for(self, document: Document) -> bool:
        """Whether it is known what to copy in a document with this content."""
        return self.fills[0].is_prepared_for(document)


def prepare_useful(document: Document, fill: FillHole) -> None:
    """Work out what a fill copies. Raises EditError where that is nothing."""
    fill.prepare(document)
    if fill.lays_nothing:
        raise EditError("nothing stands around it that would go on there")


def prepare_fills(frozen: Document, fills: Sequence[FillHole]) -> PreparedFill:
    """Work out one or more fills on a frozen copy of a document, each on what the ones before it laid.

    The copy has all fills but the last one afterwards. Raises EditError where none of them can be done.
    """
    done, refused = list[FillHole](), list[EditError]()
    for number, fill in enumerate(fills):
        with report_span(number / len(fills), (number + 1) / len(fills)):
            try:
                prepare_useful(frozen, fill)
                if number + 1 < len(fills):
                    fill.do(frozen)
                done.append(fill)
            except EditError as error:
                refused.append(error)
    if not done:
        raise refused[0]
    prepared = PreparedFill(done[0], tuple(done), tuple(refused))
    if len(done) == 1:
        return prepared
    name = max(done, key=lambda fill: fill.area).title
    if prepared.hole_count > 1:
        name = phrase("Fill {count} holes of {area:.1f} m²", count=prepared.hole_count, area=prepared.area)
    return replace(prepared, edit=CompoundEdit(prepared.fills, name))
