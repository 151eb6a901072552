"""The list of edits and how far it is done."""

from __future__ import annotations

from typing import TYPE_CHECKING

from instdrive_core.edits.document.edit import Edit

if TYPE_CHECKING:
    from instdrive_core.edits.document.document import Document


class History:
    """Edits in order; those before the cursor are done, those from it on can be redone."""

    def __init__(self) -> None:
        self._edits: list[Edit] = []
        self._cursor = 0
        self._gesture: str | None = None

    @property
    def edits(self) -> tuple[Edit, ...]:
        """All edits, done and undone."""
        return tuple(self._edits)

    @property
    def cursor(self) -> int:
        """How many edits are done."""
        return self._cursor

    @property
    def done(self) -> tuple[Edit, ...]:
        """The edits before the cursor."""
        return tuple(self._edits[: self._cursor])

    @property
    def next(self) -> Edit | None:
        """The edit that `redo` would do."""
        return self._edits[self._cursor] if self._cursor < len(self._edits) else None

    def continues_gesture(self, gesture: str | None) -> bool:
        """Whether an edit of this gesture would replace the last one."""
        return gesture is not None and gesture == self._gesture and 0 < self._cursor == len(self._edits)

    def apply(self, edit: Edit, document: Document, gesture: str | None = None) -> None:
        """Do an edit, drop what could be redone, and push it. An edit that changes nothing is not pushed.

        Edits of one `gesture` (one drag of a slider: any unique name) become one step: each replaces the one before.
        Where `edit.do` raises, document and history stay as they were.
        """
        replaces = self.continues_gesture(gesture)
        if replaces:
            self._edits[-1].undo(document)
        try:
            changed = edit.do(document)
        except Exception:
            if replaces:
                self._edits[-1].do(document)
            raise
        if replaces:
            self._cursor -= 1
            self._edits.pop()
        if changed:
            del self._edits[self._cursor :]
            self._edits.append(edit)
            self._cursor += 1
        self._gesture = gesture if changed else None

    def extend_last(self, edit: Edit, document: Document) -> None:
        """Put an edit in place of the last one, which stays done: `edit.do` does what comes on top of it.

        A gesture goes on. Where `edit.do` raises, the last edit stays. Raises ValueError where nothing is done, or
        anything can be redone.
        """
        if not 0 < self._cursor == len(self._edits):
            raise ValueError("only the last edit can be extended")
        edit.do(document)
        self._edits[-1] = edit

    def undo(self, document: Document) -> Edit | None:
        """Undo the edit before the cursor and return it; None where nothing is left."""
        if self._cursor == 0:
            return None
        edit = self._edits[self._cursor - 1]
        edit.undo(document)
        self._cursor -= 1
        self._gesture = None
        return edit

    def redo(self, document: Document) -> Edit | None:
        """Do the edit at the cursor again and return it; None where nothing is left."""
        if self._cursor == len(self._edits):
            return None
        edit = self._edits[self._cursor]
        edit.do(document)
        self._cursor += 1
        self._gesture = None
        return edit
