"""Selecting instances and splats."""

from __future__ import annotations

from instdrive_app.session.context import SessionContext
from instdrive_app.session.selection_border import SelectionBorder
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.select import SelectClass, SelectCodeword, SelectInstances, SelectMode, SelectNone
from instdrive_core.scene.selection import Flag

LOOSE_NAME = "Selection"
"""What instances made from selected splats are called, with a number."""
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

    def name_loose_splats(self) -> bool:
        """Make selected splats that belong to no instance one of their own, *Selection 1* and so on.

        Returns whether instances are selected then; what prevents it is told.
        """
        document = self._context.document
        if document is None or self.is_empty:
            return False
        if self.ids:
            return True

        def name() -> CompoundEdit:
            number = 1 + sum(instance.name.startswith(f"{LOOSE_NAME} ") for instance in document.scene.table)
            title = f"{LOOSE_NAME} {number}"
            return CompoundEdit((ReassignSelected(None), RenameInstance(document.first_free_id, title)), title)

        return self._context.apply(name)

    def clear(self) -> None:
        """Select nothing."""
        if not self.is_empty:
            self._context.apply(SelectNone)
