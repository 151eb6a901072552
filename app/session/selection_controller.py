"""Selecting instances and splats."""

from __future__ import annotations

from instdrive_app.session.context import SessionContext
from instdrive_app.session.selection_border import SelectionBorder
from instdrive_core.edits.kinds.select import SelectClass, SelectCodeword, SelectInstances, SelectMode, SelectNone
from instdrive_core.scene.selection import Flag

Ids = tuple[int, ...]


class SelectionController:
    """Reads and changes what is selected in the open document."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self.border = SelectionBorder(context)

    @property
    def ids(self) -> Ids:
        """IDs of the selected instances; empty without a document."""
        document = self._context.document
        return document.find_selected_instances() if document is not None else ()

    @property
    def is_empty(self) -> bool:
        """Whether no splat is selected, of an instance or of none."""
        document = self._context.document
        return document is None or not document.state.find_mask(Flag.SELECTED).any()

    @property
    def has_codewords(self) -> bool:
        """Whether the open scene has codewords to select by."""
        document = self._context.document
        return document is not None and document.scene.code_bits > 0

    def select(self, ids: Ids, mode: SelectMode = "replace") -> None:
        """Select instances, add them to the selection or remove them; replacing by nothing clears it."""
        if ids:
            self._context.apply(lambda: SelectInstances(ids, mode))
        elif mode == "replace":
            self.clear()

    def select_class(self, class_name: str, mode: SelectMode = "replace") -> None:
        """Select all instances of a class; an empty name means those without one."""
        self._context.apply(lambda: SelectClass(class_name, mode))

    def select_codeword(self, instance: int) -> None:
        """Select all splats that share an instance's codeword."""
        document = self._context.document
        if document is not None:
            codeword = document.scene.table[instance].codeword
            self._context.apply(lambda: SelectCodeword(codeword))

    def clear(self) -> None:
        """Select nothing."""
        if not self.is_empty:
            self._context.apply(SelectNone)
