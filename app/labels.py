"""Repairing labels: which splats belong to which instance, and of which class instances are."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.messages import Messages
from instdrive_core.edits.absorb import AbsorbFloaters
from instdrive_core.edits.compound import CompoundEdit
from instdrive_core.edits.document import Document
from instdrive_core.edits.instances import MergeInstances, RenameInstance, SetInstanceClass
from instdrive_core.edits.reassign import ReassignSelected
from instdrive_core.edits.split import SplitInstance
from instdrive_core.wording import counted

Ids = tuple[int, ...]


class Labels:
    """The verbs of label repair; each is one step of the history."""

    def __init__(self, document: Callable[[], Document | None], apply: Callable[..., bool], messages: Messages) -> None:
        """`apply` makes and does an edit of the open document, and tells the user what hinders it."""
        self._document, self._apply, self._messages = document, apply, messages

    def merge(self, ids: Ids, into: int | None = None) -> None:
        """Make several instances one: `into`, or the one with the most splats."""
        document = self._document()
        if document is None or len(ids) < 2:
            return
        table = document.scene.table
        target = into if into is not None else max(ids, key=lambda i: (table[i].count, -i))
        others = tuple(i for i in ids if i != target)
        if self._apply(MergeInstances, others, target):
            self._messages.info(f"{table[target].name} now has {counted(table[target].count, 'splat')}")

    def split(self, split: SplitInstance) -> None:
        """Make parts of an instance that are apart instances of their own: at once, where the edit is prepared."""
        document = self._document()
        before = len(document.scene.table) if document else 0
        if document is not None and self._apply(lambda: split):
            count = len(document.scene.table) - before
            self._messages.info(f"{counted(count, 'new instance')} from {_name(document, split.id)}")

    def reassign(self, into: int | None) -> None:
        """Give the selected splats to an instance, to a new one (None), or to none (0)."""
        document = self._document()
        if document is None or not self._apply(ReassignSelected, into):
            return
        if into is None:
            self._messages.info(f"New instance {document.first_free_id - 1} from the selected splats")
        elif into:
            self._messages.info(f"The selected splats belong to {_name(document, into)}")
        else:
            self._messages.info("The selected splats belong to no instance")

    def absorb(self, ids: Ids) -> None:
        """Give the strays in and around instances to them."""
        document = self._document()
        if document is None or not ids:
            return
        before = sum(document.scene.table[i].count for i in ids)
        if len(ids) == 1:
            done = self._apply(AbsorbFloaters, ids[0])
        else:
            edits = tuple(AbsorbFloaters(i) for i in ids)
            done = self._apply(CompoundEdit, edits, f"Absorb floaters of {len(ids)} instances")
        if done:
            count = sum(document.scene.table[i].count for i in ids if i in document.scene.table) - before
            self._messages.info(f"{counted(count, 'floater')} absorbed" if count > 0 else "No floaters were found")

    def rename(self, instance: int, name: str) -> None:
        """Give an instance another name."""
        self._apply(RenameInstance, instance, name)

    def set_class(self, ids: Ids, class_name: str) -> None:
        """Set the class of instances; an empty one means unknown."""
        if len(ids) == 1:
            self._apply(SetInstanceClass, ids[0], class_name)
        elif ids:
            edits = tuple(SetInstanceClass(i, class_name) for i in ids)
            self._apply(CompoundEdit, edits, f"Set class of {len(ids)} instances to {class_name or 'unknown'}")

    def classes(self) -> tuple[str, ...]:
        """The classes that occur in the scene, in alphabetical order."""
        document = self._document()
        if document is None:
            return ()
        return tuple(sorted({instance.class_name for instance in document.scene.table} - {""}, key=str.lower))


def _name(document: Document, instance: int) -> str:
    return document.scene.table[instance].name
