"""Undo and redo of the camera path's keys, in one order with the edits of the scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.history import History
from instdrive_core.filming.camera_path import CameraKey

Keys = tuple[CameraKey, ...]
MOST_STEPS = 1000


@dataclass(frozen=True)
class PathStep:
    """One change of the keys."""

    title: str
    before: Keys
    after: Keys
    gesture: str | None
    """Name of the drag that it belongs to."""
    edit: Edit | None
    """The edit of the scene that was done last when the keys changed; None before the first."""
    next_edit: Edit | None = None
    """The edit that redo would have done next when the step was undone."""


class PathSteps:
    """Steps that were done and undone. A step is next in turn while the scene is as it was when the keys changed."""

    def __init__(self) -> None:
        self._done: list[PathStep] = []
        self._undone: list[PathStep] = []

    def clear(self) -> None:
        """Forget all steps."""
        self._done.clear()
        self._undone.clear()

    def push(self, history: History, step: PathStep) -> None:
        """Note a step that was done; steps of one `gesture` become one."""
        last = self._done[-1] if self._done else None
        if last is not None and step.gesture is not None and last.gesture == step.gesture:
            step = replace(step, before=self._done.pop().before)
        self._done.append(replace(step, edit=_find_last(history)))
        del self._done[:-MOST_STEPS]
        self._undone.clear()

    def find_undo(self, history: History) -> PathStep | None:
        """Find the step that undo is about; None where it is about an edit, or about nothing."""
        step = self._done[-1] if self._done else None
        return step if step is not None and step.edit is _find_last(history) else None

    def find_redo(self, history: History) -> PathStep | None:
        """Find the step that redo is about; None where it is about an edit, or about nothing."""
        step = self._undone[-1] if self._undone else None
        fits = step is not None and step.edit is _find_last(history) and step.next_edit is history.next
        return step if fits else None

    def note_undo(self, history: History) -> None:
        """Note that the step of `find_undo` was undone."""
        self._undone.append(replace(self._done.pop(), next_edit=history.next))

    def note_redo(self) -> None:
        """Note that the step of `find_redo` was done again."""
        self._done.append(self._undone.pop())


def _find_last(history: History) -> Edit | None:
    return history.edits[history.cursor - 1] if history.cursor else None
