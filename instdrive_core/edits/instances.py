"""Changing which instance splats belong to, and what instances are called: the sole writer of `Scene.instance_ids`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy import ndarray

from instdrive_core.edits.base import Edit, checked_ids, counted
from instdrive_core.edits.document import Document
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance

MAX_NAME_LENGTH = 200


@dataclass
class RenameInstance(Edit):
    """Give an instance another name."""

    kind: ClassVar[str] = "rename_instance"
    id: int
    name: str
    _before: Instance | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        checked_ids((self.id,))
        self.name = _checked_text(self.name, "name")
        if not self.name:
            raise EditError(f"instance {self.id} needs a name of at least one character")

    @property
    def title(self) -> str:
        """``Rename instance 17 to taxi``."""
        return f"Rename instance {self.id} to {self.name}"

    def do(self, document: Document) -> bool:
        """Replace the table's entry."""
        self._before = _known(document, self.id)
        return _replaced(document, self._before, replace(self._before, name=self.name))

    def undo(self, document: Document) -> None:
        """Put the old entry back."""
        assert self._before is not None
        _replaced(document, document.scene.table[self.id], self._before)


@dataclass
class SetInstanceClass(Edit):
    """Set the class of an instance; an empty one means unknown."""

    kind: ClassVar[str] = "set_instance_class"
    id: int
    class_name: str
    _before: Instance | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        checked_ids((self.id,))
        self.class_name = _checked_text(self.class_name, "class")

    @property
    def title(self) -> str:
        """``Set class of instance 17 to Car``."""
        return f"Set class of instance {self.id} to {self.class_name or 'unknown'}"

    def do(self, document: Document) -> bool:
        """Replace the table's entry."""
        self._before = _known(document, self.id)
        return _replaced(document, self._before, replace(self._before, class_name=self.class_name))

    def undo(self, document: Document) -> None:
        """Put the old entry back."""
        assert self._before is not None
        _replaced(document, document.scene.table[self.id], self._before)


@dataclass
class MergeInstances(Edit):
    """Give all splats of some instances to one; the IDs given up are never used again."""

    kind: ClassVar[str] = "merge_instances"
    ids: tuple[int, ...]
    into: int
    _rows: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _ids_before: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _table_before: tuple[Instance, ...] = field(default=(), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.ids = checked_ids(self.ids)
        checked_ids((self.into,))

    @property
    def title(self) -> str:
        """``Merge 2 instances into instance 17``."""
        return f"Merge {counted(self.ids)} into instance {self.into}"

    def do(self, document: Document) -> bool:
        """Write the IDs and join the table's entries."""
        others = [_known(document, instance_id) for instance_id in self.ids if instance_id != self.into]
        target = _known(document, self.into)
        strangers = [instance for instance in others if instance.node != target.node]
        if strangers:
            raise EditError(
                f"instance {strangers[0].id} moves with another object than instance {target.id}; "
                "only instances of the same track, or two of the background, can be merged"
            )
        if not others:
            return False
        rows = document.rows_of([instance.id for instance in others])
        self._rows, self._ids_before = rows.astype(np.int32), document.scene.instance_ids[rows]
        self._table_before = (target, *others)
        document.scene.instance_ids[rows] = self.into
        for instance in others:
            del document.scene.table.instances[instance.id]
        document.scene.table.set(_joined(target, others))
        document.instances_changed(ids_changed=True)
        return True

    def undo(self, document: Document) -> None:
        """Write the old IDs back and restore the table's entries."""
        document.scene.instance_ids[self._rows] = self._ids_before
        for instance in self._table_before:
            document.scene.table.set(instance)
        document.instances_changed(ids_changed=True)


def _known(document: Document, instance_id: int) -> Instance:
    if instance_id not in document.scene.table:
        raise EditError(f"the scene has no instance {instance_id}")
    return document.scene.table[instance_id]


def _replaced(document: Document, before: Instance, after: Instance) -> bool:
    if before == after:
        return False
    document.scene.table.set(after)
    document.instances_changed(ids_changed=False)
    return True


def _joined(target: Instance, others: list[Instance]) -> Instance:
    parts = [instance for instance in (target, *others) if instance.count]
    if not parts:
        return target
    low = np.min([instance.bounds[0] for instance in parts], axis=0)
    high = np.max([instance.bounds[1] for instance in parts], axis=0)
    bounds = (tuple(low.tolist()), tuple(high.tolist()))
    return replace(target, count=sum(instance.count for instance in parts), bounds=bounds)


def _checked_text(text: str, what: str) -> str:
    if not isinstance(text, str) or len(text) > MAX_NAME_LENGTH or not (text.isprintable()):
        raise EditError(f"{what} {text!r} is not a line of printable text of at most {MAX_NAME_LENGTH} characters")
    return text.strip()
