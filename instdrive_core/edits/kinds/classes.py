"""Setting the class of any number of instances."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

from instdrive_core.edits.bases.editable import check_unlocked
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.relabel import check_text, get_instance, restore_entries
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit, describe_ids
from instdrive_core.instances.table import Instance
from instdrive_core.wording import phrase


@dataclass
class SetClass(Edit):
    """Set the class of instances; an empty one means unknown."""

    kind: ClassVar[str] = "set_class"
    ids: tuple[int, ...]
    class_name: str
    _before: dict[int, Instance | None] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Entries of the instances that had another class."""

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        self.class_name = check_text(self.class_name, "class")

    @property
    def title(self) -> str:
        """``Set class of 3 instances to Car``."""
        return phrase(
            "Set class of {objects} to {name}",
            objects=describe_ids(self.ids),
            name=self.class_name or phrase("unknown"),
        )

    def do(self, document: Document) -> bool:
        """Replace the table's entries. Raises EditError where one of the instances is locked or unknown."""
        entries = [get_instance(document, instance_id) for instance_id in self.ids]
        check_unlocked(document, self.ids)
        others = [entry for entry in entries if entry.class_name != self.class_name]
        self._before = {entry.id: entry for entry in others}
        for entry in others:
            document.scene.table.set(replace(entry, class_name=self.class_name))
        if others:
            document.note_instances_changed(ids_changed=False)
        return bool(others)

    def undo(self, document: Document) -> None:
        """Put the old entries back."""
        restore_entries(document, self._before)
        document.note_instances_changed(ids_changed=False)


@dataclass
class SetInstanceClass(Edit):
    """`SetClass` of one instance, as projects hold it that were saved before there was one of many."""

    kind: ClassVar[str] = "set_instance_class"
    id: int
    class_name: str
    _edit: SetClass = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self._edit = SetClass((self.id,), self.class_name)
        self.class_name = self._edit.class_name

    @property
    def title(self) -> str:
        """``Set class of instance 17 to Car``."""
        return self._edit.title

    def do(self, document: Document) -> bool:
        """Replace the table's entry. Raises EditError where the instance is locked or unknown."""
        return self._edit.do(document)

    def undo(self, document: Document) -> None:
        """Put the old entry back."""
        self._edit.undo(document)
