"""Renaming an instance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

from instdrive_core.edits.bases.editable import check_unlocked
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.relabel import check_text, get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance
from instdrive_core.wording import phrase


@dataclass
class RenameInstance(Edit):
    """Give an instance another name."""

    kind: ClassVar[str] = "rename_instance"
    id: int
    name: str
    _before: Instance | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_ids((self.id,))
        self.name = check_text(self.name, "name")
        if not self.name:
            raise EditError(phrase("instance {id} needs a name of at least one character", id=self.id))

    @property
    def title(self) -> str:
        """``Rename instance 17 to taxi``."""
        return phrase("Rename instance {id} to {name}", id=self.id, name=self.name)

    def do(self, document: Document) -> bool:
        """Replace the table's entry. Raises EditError where the instance is locked."""
        self._before = get_instance(document, self.id)
        check_unlocked(document, (self.id,))
        return _replace_entry(document, self._before, replace(self._before, name=self.name))

    def undo(self, document: Document) -> None:
        """Put the old entry back."""
        assert self._before is not None
        _replace_entry(document, document.scene.table[self.id], self._before)


def _replace_entry(document: Document, before: Instance, after: Instance) -> bool:
    if before == after:
        return False
    document.scene.table.set(after)
    document.note_instances_changed(ids_changed=False)
    return True
