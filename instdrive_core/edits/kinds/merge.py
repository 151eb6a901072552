"""Merging instances into one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy import ndarray

from instdrive_core.edits.bases.editable import check_unlocked
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.relabel import assign_instances, get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit, describe_ids
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance
from instdrive_core.wording import phrase


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
        self.ids = check_ids(self.ids)
        check_ids((self.into,))

    @property
    def title(self) -> str:
        """``Merge 2 instances into instance 17``."""
        return phrase("Merge {objects} into instance {into}", objects=describe_ids(self.ids), into=self.into)

    def do(self, document: Document) -> bool:
        """Write the IDs and join the table's entries."""
        others = [get_instance(document, instance_id) for instance_id in self.ids if instance_id != self.into]
        target = get_instance(document, self.into)
        strangers = [instance for instance in others if instance.node != target.node]
        if strangers:
            raise EditError(
                phrase(
                    "instance {id} moves with another object than instance {other}; only instances of the "
                    "same track, or two of the background, can be merged",
                    id=strangers[0].id,
                    other=target.id,
                )
            )
        if not others:
            return False
        check_unlocked(document, (self.into, *(instance.id for instance in others)))
        rows = document.find_rows([instance.id for instance in others])
        self._rows, self._ids_before = rows.astype(np.int32), document.scene.instance_ids[rows]
        self._table_before = (target, *others)
        assign_instances(document, rows, self.into)
        for instance in others:
            del document.scene.table.instances[instance.id]
        document.scene.table.set(_join_entries(target, others))
        return True

    def undo(self, document: Document) -> None:
        """Write the old IDs back and restore the table's entries."""
        assert self._rows is not None
        assert self._ids_before is not None
        assign_instances(document, self._rows, self._ids_before)
        for instance in self._table_before:
            document.scene.table.set(instance)


def _join_entries(target: Instance, others: list[Instance]) -> Instance:
    parts = [instance for instance in (target, *others) if instance.count]
    if not parts:
        return target
    low = np.min([instance.bounds[0] for instance in parts], axis=0)
    high = np.max([instance.bounds[1] for instance in parts], axis=0)
    bounds = (tuple(low.tolist()), tuple(high.tolist()))
    return replace(target, count=sum(instance.count for instance in parts), bounds=bounds)
