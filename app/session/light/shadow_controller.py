"""Shadows: laid below what was moved, copied or inserted, once it stays where it is, or on request."""

from __future__ import annotations

from weakref import ref

from instdrive_app.session.context import SessionContext
from instdrive_app.session.move_controller import MoveOptions
from instdrive_app.session.placing.settled_step import SettledStep
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit, describe_ids
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.holes.scene_light import estimate_light
from instdrive_core.edits.holes.shade import SceneLight
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.edits.kinds.light.cast_shadows import Put, find_put, plan_shadows
from instdrive_core.edits.kinds.light.lay_shadow import find_shadow_rows, make_lay_shadow
from instdrive_core.wording import format_count, phrase

Ids = tuple[int, ...]


class ShadowController:
    """Lays and removes shadows of the open document's things; those laid by themselves are part of the step before."""

    def __init__(self, context: SessionContext, options: MoveOptions) -> None:
        self._context, self._jobs, self._messages = context, context.jobs, context.messages
        self._options = options
        self._step = SettledStep()
        self._light: tuple[ref[Document], SceneLight] | None = None

    def has_shadow(self, ids: Ids) -> bool:
        """Whether a shadow was laid below any of the instances."""
        document = self._context.document
        return document is not None and any(len(find_shadow_rows(document, number)) for number in ids)

    def tick(self, seconds: float, is_dragging: bool) -> None:
        """Lay shadows once the last step stays for a moment; called once a frame."""
        document = self._context.document
        last = self._step.look(document, seconds, is_dragging)
        if document is not None and last is not None and self._options.lays_shadows:
            self._follow(document, last)

    def add(self, ids: Ids) -> None:
        """Lay a shadow below instances, wherever they stand; says why one gets none."""
        document, time = self._context.document, self._context.state.time
        if document is None or not ids:
            return
        frozen = freeze_document(document)

        def finish(light: SceneLight) -> None:
            if self._context.document is document:
                self._light = (ref(document), light)
                steps = tuple(make_lay_shadow(number, light, time) for number in ids)
                title = phrase("Lay shadows of {objects}", objects=describe_ids(ids))
                self._context.apply(lambda: steps[0] if len(steps) == 1 else CompoundEdit(steps, title))

        self._jobs.submit(
            "Looking for the light", lambda: self._find_light(document, frozen, time), finish, modal=False
        )

    def remove(self, ids: Ids) -> None:
        """Take the shadows away that were laid below instances."""
        document = self._context.document
        if document is None:
            return
        steps = tuple(DeleteRows(rows) for number in ids if len(rows := find_shadow_rows(document, number)))
        if steps:
            self._context.apply(
                lambda: CompoundEdit(steps, phrase("Remove the shadow of {objects}", objects=describe_ids(ids)))
            )

    def _follow(self, document: Document, last: Edit) -> None:
        """Lay the shadows of what the last step has put somewhere, and make them part of that step."""
        put, time, frozen = find_put(last), self._context.state.time, freeze_document(document)

        def plan() -> tuple[SceneLight, tuple[Edit, ...]]:
            light = self._find_light(document, frozen, time)
            return light, plan_shadows(frozen, put, light, time)

        def finish(found: tuple[SceneLight, tuple[Edit, ...]]) -> None:
            light, steps = found
            self._light = (ref(document), light)
            history = document.history
            if self._context.document is not document or not steps or history.next is not None:
                return
            if history.done and history.done[-1] is last and not self._jobs.is_blocking:
                joined = CompoundEdit.extend(last, steps)
                document.extend_last(joined)
                self._step.replace(document, joined)

        self._jobs.submit_in_background(
            phrase("Looking for the shadow of {what}", what=_name(document, put)), plan, finish
        )

    def _find_light(self, document: Document, frozen: Document, time: float) -> SceneLight:
        known = self._light
        return known[1] if known is not None and known[0]() is document else estimate_light(frozen, time)


def _name(document: Document, put: Put) -> str:
    first = document.scene.table.instances.get(put.ids[0])
    return first.name if first is not None and len(put.ids) == 1 else format_count(len(put.ids), "thing")
