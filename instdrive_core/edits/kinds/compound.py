"""Several edits as one step."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.errors import EditError
from instdrive_core.wording import phrase


@dataclass
class CompoundEdit(Edit):
    """Edits done in order and undone in reverse; where one fails, those before it are undone."""

    kind: ClassVar[str] = "compound"
    edits: tuple[Edit, ...]
    name: str
    """The title of the step."""
    _done: list[Edit] = field(default_factory=list, init=False, repr=False, compare=False)
    _begun: int = field(default=0, init=False, repr=False, compare=False)
    """Edits, the first ones, that are done before `do` is called."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise EditError(phrase("name {name!r} of a compound edit is no text", name=self.name))

    @property
    def title(self) -> str:
        """The given name."""
        return self.name

    @classmethod
    def extend(cls, last: Edit, more: tuple[Edit, ...]) -> CompoundEdit:
        """Join edits to the document's last one, which is done: for `Document.extend_last`, which does the others."""
        is_compound = isinstance(last, CompoundEdit)
        joined = cls((*last.edits, *more) if is_compound else (last, *more), last.title)
        joined._done, joined._begun = list(last._done) if is_compound else [last], len(joined.edits) - len(more)
        return joined

    def do(self, document: Document) -> bool:
        """Do all edits, or none of them."""
        before, begun = self._done[:] if self._begun else [], self._begun
        self._done, self._begun = before[:], 0
        try:
            for edit in self.edits[begun:]:
                if edit.do(document):
                    self._done.append(edit)
        except Exception:
            for edit in reversed(self._done[len(before) :]):
                edit.undo(document)
            raise
        return bool(self._done)

    def undo(self, document: Document) -> None:
        """Undo those that changed anything, last first."""
        for edit in reversed(self._done):
            edit.undo(document)

    def to_json(self) -> dict[str, object]:
        """Kind and parameters, with each part's JSON in place of the part."""
        return {"kind": self.kind, "edits": [edit.to_json() for edit in self.edits], "name": self.name}
