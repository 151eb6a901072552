"""Labels whose outcome is given: what was found on one scene holds on one that was trained on from it, and what photos
show of a scene is found out elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from instdrive_core.edits.bases.flags import FlagChange
from instdrive_core.edits.bases.parameters import check_switch, is_whole
from instdrive_core.edits.bases.relabel import RelabelEdit, Relabeling, check_text, create_instances, get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.row_runs import RowRuns, expand_runs, make_runs
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase

_TITLES = {
    "absorb_floaters": phrase("Absorb floaters of instance {id}"),
    "split_instance": phrase("Split instance {id}"),
    "find_objects": phrase("Find objects"),
}
"""Titles by the kind of edit that found out which rows go where."""


@dataclass
class RelabelRows(RelabelEdit):
    """Give rows to instances, or to new ones, as another edit has found out before."""

    kind: ClassVar[str] = "relabel_rows"
    found_by: str
    """Kind of the edit that found it out."""
    parts: tuple[RowRuns | Sequence[object], ...]
    """Row numbers of each part as an array, or as runs of pairs (first row, number of rows); kept as runs."""
    into: tuple[int | None, ...]
    """Instance that each part goes to, 0 = none; None = a new one."""
    like: int = 0
    """Instance that new ones take after; 0 = none."""
    deletes: bool = False
    """Whether the parts are deleted, too: they join an instance that is."""
    classes: tuple[str, ...] = ()
    """Class of each part's new instance, which also names it; empty = unknown. No entries at all = all unknown."""
    _flags_done: list[FlagChange] = field(default_factory=list, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.found_by not in _TITLES:
            raise EditError(
                phrase("found_by {name!r} is none of {known}", name=self.found_by, known=", ".join(_TITLES))
            )
        self.parts = tuple(make_runs(part) for part in self.parts)
        self.into = tuple(self.into)
        if len(self.into) != len(self.parts) or not all(
            number is None or (is_whole(number) and number >= 0) for number in self.into
        ):
            raise EditError(phrase("into {into!r} is not one instance, 0 or nothing for each part", into=self.into))
        if not is_whole(self.like) or self.like < 0:
            raise EditError(phrase("like {like!r} is no instance", like=self.like))
        check_switch(self.deletes, "deletes")
        self.classes = tuple(check_text(name, "class") for name in self.classes)
        if self.classes and len(self.classes) != len(self.parts):
            raise EditError(phrase("classes {classes!r} are not one for each part", classes=self.classes))

    @property
    def title(self) -> str:
        """``Split instance 17`` or whatever found it out."""
        named = next((number for number in self.into if number), 0)
        return phrase(_TITLES[self.found_by], id=self.like or named)

    def to_json(self) -> dict[str, object]:
        """Kind and parameters, with the rows as runs."""
        values = self.get_parameters()
        parts = [make_runs(part).to_json() for part in self.parts]
        return values | {"parts": parts, "into": list(self.into), "classes": list(self.classes)}

    def plan_relabelings(self, document: Document) -> list[Relabeling]:
        """Each part to its target. Raises EditError for rows or instances that the scene does not have."""
        rows = [expand_runs(make_runs(part), len(document.scene)) for part in self.parts]
        source = get_instance(document, self.like) if self.like else None
        created = iter(create_instances(document, [source for number in self.into if number is None]))
        targets = [
            _name_by_class(next(created), class_name)
            if number is None
            else get_instance(document, number)
            if number
            else None
            for number, class_name in zip(self.into, self.classes or ("",) * len(self.into), strict=True)
        ]
        return [Relabeling(*pair) for pair in zip(rows, targets, strict=True)]

    def do(self, document: Document) -> bool:
        """Relabel, and delete where that is asked for."""
        if not super().do(document):
            return False
        self._flags_done = []
        if self.deletes:
            rows = np.concatenate([make_runs(part).rows for part in self.parts])
            for flag, on in ((Flag.SELECTED, False), (Flag.DELETED, True)):
                self._flags_done.append(FlagChange(document.state.change(rows, flag, on), flag, on))
        return True

    def undo(self, document: Document) -> None:
        """Bring back what was deleted, then the labels."""
        for rows, flag, on in reversed(self._flags_done):
            document.state.change(rows, flag, not on)
        super().undo(document)


def _name_by_class(instance: Instance, class_name: str) -> Instance:
    """A new instance of a class, with a name that training would give it."""
    return replace(instance, class_name=class_name, name=f"{class_name} {instance.id}") if class_name else instance
