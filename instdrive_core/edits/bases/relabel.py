"""Changes of the instance each splat belongs to, and of the table of instances."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.synthetic_rows import LEARNED_SHADOW, SYNTHETIC
from instdrive_core.edits.queries.part_bounds import compute_part_bounds, find_main_nodes_of_parts
from instdrive_core.errors import EditError
from instdrive_core.instances.colormap import ID_LIMIT
from instdrive_core.instances.table import Instance, make_default_name
from instdrive_core.wording import phrase

MAX_NAME_LENGTH = 200


class Relabeling(NamedTuple):
    """Rows and the instance they go to, which may be new to the table; None = no instance."""

    rows: ndarray
    target: Instance | None


@dataclass
class RelabelEdit(Edit):
    """An edit of instance IDs: subclasses say which rows go where, this class writes, remembers and undoes."""

    _rows: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _ids_before: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _table_before: dict[int, Instance | None] = field(default_factory=dict, init=False, repr=False, compare=False)
    _free_before: int = field(default=1, init=False, repr=False, compare=False)

    def get_changed_rows(self) -> ndarray:
        """Rows whose instance the last `do` changed. Raises ValueError where it changed nothing yet."""
        if self._rows is None:
            raise ValueError("the edit was not done")
        return self._rows.astype(np.int64)

    @abstractmethod
    def plan_relabelings(self, document: Document) -> list[Relabeling]:
        """Which rows go where; no row twice. Raises EditError where the edit does not fit."""

    def do(self, document: Document) -> bool:
        """Write the IDs and count the instances that gained or lost rows again; the emptied ones leave the table."""
        parts = [part for part in self.plan_relabelings(document) if len(part.rows)]
        rows = np.concatenate([np.zeros(0, np.int64), *(part.rows for part in parts)])
        ids = np.repeat([part.target.id if part.target else 0 for part in parts], [len(part.rows) for part in parts])
        changed = document.scene.instance_ids[rows] != ids
        if not changed.any():
            return False
        self._rows, self._ids_before = rows[changed].astype(np.int32), document.scene.instance_ids[rows[changed]]
        targets = {part.target.id: part.target for part in parts if part.target}
        touched = sorted((set(np.unique(self._ids_before).tolist()) | set(targets)) - {0})
        table = document.scene.table
        self._table_before = {number: table.instances.get(number) for number in touched}
        self._free_before = document.first_free_id
        assign_instances(document, self._rows, ids[changed])
        document.first_free_id = max(document.first_free_id, max(targets, default=0) + 1)
        for number in touched:
            entry = self._table_before[number] or targets.get(number)
            if entry is not None:
                table.set(entry)
        recount_instances(document, touched)
        return True

    def undo(self, document: Document) -> None:
        """Write the old IDs back and restore the table's entries."""
        assert self._rows is not None
        assert self._ids_before is not None
        assign_instances(document, self._rows, self._ids_before)
        restore_entries(document, self._table_before)
        document.first_free_id = self._free_before


def assign_instances(document: Document, rows: ndarray, ids: ndarray | int) -> None:
    """Write the instance IDs of rows (0 = none): the sole writer. The table is left to the caller."""
    document.scene.instance_ids[rows] = ids
    document.note_instances_changed(ids_changed=True)


def recount_instances(document: Document, ids: Iterable[int]) -> None:
    """Compute counts, bounds and nodes of instances in the table again; those without rows leave the table."""
    table = document.scene.table
    known = [instance_id for instance_id in ids if instance_id in table]
    parts = document.find_row_parts(known)
    for place in np.flatnonzero(parts.sizes == 0).tolist():
        del table.instances[known[place]]
    left = parts.drop_empty()
    known = [instance_id for instance_id in known if instance_id in table]
    nodes = find_main_nodes_of_parts(document, left)
    counted = left
    if document.scene.actors:
        counted = left.filter(document.scene.nodes[left.rows] == np.repeat(nodes, left.sizes))
    if SYNTHETIC in document.scene.extra:
        bodies = counted.filter(document.scene.extra[SYNTHETIC][counted.rows] != LEARNED_SHADOW)
        counted = bodies if bodies.sizes.all() else counted
    bounds = compute_part_bounds(document, counted).tolist()
    facts = zip(known, nodes.tolist(), left.sizes.tolist(), bounds, strict=True)
    for instance_id, node, count, (low, high) in facts:
        entry = table[instance_id]
        box = ((low[0], low[1], low[2]), (high[0], high[1], high[2]))
        table.set(Instance(entry.id, entry.name, node, entry.codeword, count, entry.class_name, box))


def add_entries(
    document: Document, entries: Iterable[Instance], counted: tuple[Instance, ...] | None = None
) -> tuple[Instance, ...]:
    """Put new instances, whose rows are in the scene already, into the table and count them.

    Returns their entries as they are counted, without those that have no rows. `counted`: these, where they are known.
    """
    entries, table = tuple(entries), document.scene.table
    document.first_free_id = max(document.first_free_id, max((entry.id for entry in entries), default=0) + 1)
    for entry in entries if counted is None else counted:
        table.set(entry)
    document.note_instances_changed(ids_changed=True)
    if counted is not None:
        return counted
    recount_instances(document, [entry.id for entry in entries])
    return tuple(table[entry.id] for entry in entries if entry.id in table)


def restore_entries(document: Document, entries: dict[int, Instance | None]) -> None:
    """Put entries of the table back as they were; None = there was none."""
    for instance_id, entry in entries.items():
        if entry is not None:
            document.scene.table.set(entry)
        else:
            document.scene.table.instances.pop(instance_id, None)


def create_instances(document: Document, like: Iterable[Instance | None]) -> list[Instance]:
    """New entries with IDs that were never used; each takes node, codeword, class and name from an entry, or from None.

    Raises EditError where no 24-bit ID is left.
    """
    entries: list[Instance] = []
    for number, source in enumerate(like, start=document.first_free_id):
        if number >= ID_LIMIT:
            raise EditError(
                phrase(
                    "no instance ID below {most} is free; export the scene to number its instances afresh",
                    most=ID_LIMIT,
                )
            )
        if source is None or source.name == make_default_name(source.id):
            name = make_default_name(number)
        else:
            name = f"{source.name[: MAX_NAME_LENGTH - 12]} ({number})"
        blank = Instance(number, name)
        if source is not None:
            blank = replace(blank, node=source.node, codeword=source.codeword, class_name=source.class_name)
        entries.append(blank)
    return entries


def get_instance(document: Document, instance_id: int) -> Instance:
    """The table's entry of an instance. Raises EditError where there is none."""
    if instance_id not in document.scene.table:
        raise EditError(phrase("the scene has no instance {instance_id}", instance_id=instance_id))
    return document.scene.table[instance_id]


def check_text(text: str, what: str) -> str:
    """The text without blanks around it. Raises EditError where it is no printable line of reasonable length."""
    if not isinstance(text, str) or len(text) > MAX_NAME_LENGTH or not (text.isprintable()):
        raise EditError(
            phrase(
                "{what} {text!r} is not a line of printable text of at most {most} characters",
                what=what,
                text=text,
                most=MAX_NAME_LENGTH,
            )
        )
    return text.strip()
