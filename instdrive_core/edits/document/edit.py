"""The base class of all edits: an edit does and undoes one change, and remembers only what it touched."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from instdrive_core.wording import format_count, phrase

if TYPE_CHECKING:
    from instdrive_core.edits.document.document import Document  # which holds a history of edits


EditT = TypeVar("EditT", bound="Edit")


class Edit(ABC):
    """One undoable change to a `Document`.

    Subclasses are dataclasses: fields given to the constructor are the edit's parameters, from which `do` can be
    replayed on an equal document; everything `undo` needs is kept in fields with ``init=False``.
    """

    kind: ClassVar[str]
    """The name under which the edit is serialised; never changes once released."""
    selects_only: ClassVar[bool] = False
    """Whether nothing but the selection changes: then there is nothing to save."""

    @property
    @abstractmethod
    def title(self) -> str:
        """What the history panel shows, e.g. ``Delete instance 17``."""

    @abstractmethod
    def do(self, document: Document) -> bool:
        """Change the document; returns whether anything changed. Raises EditError before the first write."""

    @abstractmethod
    def undo(self, document: Document) -> None:
        """Restore, bit by bit, what the last `do` changed."""

    def copy_undone(self: EditT, **changes: Any) -> EditT:
        """Copy the edit, with other parameters where some are given, as it was before it was done."""
        return replace(self, **changes)  # type: ignore[type-var]

    def to_json(self) -> dict[str, object]:
        """Kind and parameters, ready for json.dumps."""
        return self.get_parameters()

    def get_parameters(self) -> dict[str, object]:
        """Kind and parameters as the edit holds them: where `to_json` makes long lists, they may be arrays here."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.init}  # type: ignore[arg-type]
        return {"kind": self.kind, **values}


def describe_ids(ids: tuple[int, ...]) -> str:
    """``instance 17`` or ``3 instances``, for titles."""
    return phrase("instance {id}", id=ids[0]) if len(ids) == 1 else format_count(len(ids), "instance")
