"""Repairing labels: which instance splats belong to, and which class instances have."""

from __future__ import annotations

from copy import copy

from instdrive_app.session.context import SessionContext
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.absorb import AbsorbFloaters
from instdrive_core.edits.kinds.classes import SetClass
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.find_objects import FindObjects
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.progress import report
from instdrive_core.wording import format_count, phrase

Ids = tuple[int, ...]


class LabelController:
    """Repairs labels; each repair is one step of the history."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._jobs, self._messages = context, context.jobs, context.messages

    def merge(self, ids: Ids, into: int | None = None) -> None:
        """Merge instances `into` one of them, by default the one with the most splats."""
        document = self._context.document
        if document is None or len(ids) < 2:
            return
        table = document.scene.table
        target = into if into is not None else max(ids, key=lambda i: (table[i].count, -i))
        others = tuple(i for i in ids if i != target)
        if self._context.apply(lambda: MergeInstances(others, target)):
            self._messages.info(
                phrase(
                    "{name} now has {splats}",
                    name=table[target].name,
                    splats=format_count(table[target].count, "splat"),
                )
            )

    def split(self, split: SplitInstance) -> None:
        """Split an instance into its separate parts, which are looked for in the background unless that was done."""
        document = self._context.document
        if document is None:
            return
        if split.is_prepared_for(document):
            self._split(document, split)
            return
        frozen = freeze_document(document)

        def finish(_: tuple[int, ...]) -> None:
            if self._context.document is document:
                self.split(split)  # searches again where the document was edited in the meantime

        self._jobs.submit("Looking for parts", lambda: split.prepare(frozen), finish, modal=False)

    def _split(self, document: Document, split: SplitInstance) -> None:
        before = len(document.scene.table)
        if self._context.apply(split):
            count = len(document.scene.table) - before
            made = format_count(count, "new instance")
            self._messages.info(phrase("{instances} from {name}", instances=made, name=_find_name(document, split.id)))

    def reassign(self, into: int | None) -> None:
        """Assign the selected splats to an instance, to a new one (None), or to none (0)."""
        document = self._context.document
        if document is None or not self._context.apply(lambda: ReassignSelected(into)):
            return
        if into is None:
            self._messages.info(phrase("New instance {id} from the selected splats", id=document.first_free_id - 1))
        elif into:
            self._messages.info(phrase("The selected splats belong to {name}", name=_find_name(document, into)))
        else:
            self._messages.info("The selected splats belong to no instance")

    def absorb(self, ids: Ids) -> None:
        """Assign the floaters in and around instances to them; they are searched in the background."""
        document = self._context.document
        if document is None or not ids:
            return
        edits, frozen = tuple(AbsorbFloaters(i) for i in ids), freeze_document(document)

        def look() -> None:
            for number, edit in enumerate(edits):
                report(number / len(edits))
                edit.prepare(frozen)
                copy(edit).do(frozen)  # so that the next one finds only what this one leaves

        def finish(_: None) -> None:
            if self._context.document is not document:
                return
            if edits[0].is_prepared_for(document):
                self._absorb(document, edits)
            else:  # the document was edited in the meantime: search again
                self.absorb(tuple(i for i in ids if i in document.scene.table))

        self._jobs.submit("Looking for floaters", look, finish, modal=False)

    def _absorb(self, document: Document, edits: tuple[AbsorbFloaters, ...]) -> None:
        table, ids = document.scene.table, [edit.id for edit in edits]
        before = sum(table[i].count for i in ids)
        if len(edits) == 1:
            done = self._context.apply(edits[0])
        else:
            done = self._context.apply(
                CompoundEdit(
                    edits, phrase("Absorb floaters of {instances}", instances=format_count(len(edits), "instance"))
                )
            )
        if done:
            count = sum(table[i].count for i in ids if i in table) - before
            absorbed = phrase("{floaters} absorbed", floaters=format_count(count, "floater"))
            self._messages.info(absorbed if count > 0 else "No floaters were found")

    def find_objects(self) -> None:
        """Make instances of what stands on the ground and belongs to none; they are searched in the background."""
        document = self._context.document
        if document is None:
            return
        edit, frozen = FindObjects(), freeze_document(document)

        def finish(_: int) -> None:
            if self._context.document is not document:
                return
            before = len(document.scene.table)
            if not edit.is_prepared_for(document):  # the document was edited in the meantime
                self.find_objects()
            elif self._context.apply(edit):
                if not before:  # a region would have selected no instance before
                    self._context.state.region_splats = False
                found = format_count(len(document.scene.table) - before, "object")
                self._messages.info(phrase("{found} found; click them like any instance", found=found))

        self._jobs.submit("Looking for objects", lambda: edit.prepare(frozen), finish, modal=False)

    def rename(self, instance: int, name: str) -> None:
        """Rename an instance."""
        self._context.apply(lambda: RenameInstance(instance, name))

    def set_class(self, ids: Ids, class_name: str) -> None:
        """Set the class of instances; an empty name means unknown."""
        if ids:
            self._context.apply(lambda: SetClass(ids, class_name))

    def list_classes(self) -> tuple[str, ...]:
        """List the classes that occur in the scene, in alphabetical order."""
        document = self._context.document
        if document is None:
            return ()
        return tuple(sorted({instance.class_name for instance in document.scene.table} - {""}, key=str.lower))


def _find_name(document: Document, instance: int) -> str:
    return document.scene.table[instance].name
