"""The tool that picks instances: the one under the cursor is hovered, and a click selects it."""

from __future__ import annotations

from instdrive_app.pointer import Click, Operation, Point
from instdrive_app.render.picking import Picker
from instdrive_app.render.shown_frame import find_shown_instance
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import FrameSnapshot, Stack
from instdrive_core.edits.document.document import Document

SAME_PLACE = 4.0
"""Distance, in pixels at scale 1, within which a second click means the same place."""


class PickTool:
    """Picks whole instances.

    A click selects, a double click frames, a slow second click takes the next instance behind; Shift adds, Ctrl
    removes, Alt takes the codeword.
    """

    drags: bool = False
    options: tuple[str, ...] = ()
    outline: tuple[Point, ...] = ()
    trail: tuple[Point, ...] = ()
    ring: float = 0.0
    operation: Operation | None = None

    def __init__(self, session: EditorSession, picker: Picker | None = None) -> None:
        """Tools can share a `picker`, which keeps a few numbers per splat."""
        self._session = session
        self._picker = picker or Picker()
        self._last: tuple[float, float, bytes] | None = None
        self._depth = 0

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """Hover what is at this position (pixels) of the frame `snapshot`; nothing while the camera moves."""
        self._session.state.hovered = 0 if snapshot.draft else self._find_first(x, y, snapshot)

    def leave(self) -> None:
        """Hover nothing: the cursor is elsewhere."""
        self._session.state.hovered = 0

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Select by a click on the frame `snapshot`, or frame what is selected; returns the instance, 0 for none."""
        if click.double:
            return self._frame_selected()
        instance = self._find_first(click.x, click.y, snapshot)
        turn = self._count_turns(click, snapshot) if instance else 0
        self._session.state.stack = None
        if turn:
            below = self._find_all(click.x, click.y, snapshot)
            instance = below[turn % len(below)] if below else instance
            self._list_stack(below, instance, click, snapshot)
        self._select(instance, click)
        return instance

    def cycle(self, click: Click, snapshot: FrameSnapshot, step: int) -> int:
        """Select the instance so many farther behind (negative: before) than the selected one at this position."""
        below = self._find_all(click.x, click.y, snapshot)
        if not below:
            return 0
        chosen = self._session.selection.ids
        here = below.index(chosen[0]) if len(chosen) == 1 and chosen[0] in below else None
        instance = below[0 if here is None else (here + step) % len(below)]
        self._session.selection.select((instance,), "replace")
        self._list_stack(below, instance, click, snapshot)
        return instance

    def _list_stack(self, below: tuple[int, ...], chosen: int, click: Click, snapshot: FrameSnapshot) -> None:
        """Let the window name what lies behind each other here."""
        if len(below) > 1:
            pose = snapshot.camera.world_from_camera.tobytes()
            self._session.state.stack = Stack(below, below.index(chosen), (click.x, click.y), pose)

    def _frame_selected(self) -> int:
        """Bring into view what the first click of a double click has selected."""
        self._last, self._session.state.stack = None, None
        ids = self._session.selection.ids
        if ids:
            self._session.navigation.frame(ids)
        return ids[0] if ids else 0

    def drag(self, start: Point, to: Point) -> None:
        """Do nothing: drags move the camera."""

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """Do nothing: drags move the camera."""

    def cancel(self) -> None:
        """Do nothing: no drag is ever under way."""

    def _find_first(self, x: float, y: float, snapshot: FrameSnapshot) -> int:
        """Find the instance that a position of a frame stands for, 0 for none; frames that know their winners answer.

        Locked instances are skipped as far as others can be seen through them: a first click takes nothing unseen.
        """
        document = self._session.document
        if document is None:
            return 0
        shown = find_shown_instance(document, snapshot, x, y)
        if shown is not None and not (shown and document.summarize_instance(shown).is_locked):
            return shown
        return next(iter(self._drop_locked(document, self._picker.find_below(document, snapshot, x, y).seen)), 0)

    def _find_all(self, x: float, y: float, snapshot: FrameSnapshot) -> tuple[int, ...]:
        """Find the instances that clicks at one position take in turn, including those behind solid things."""
        document = self._session.document
        if document is None:
            return ()
        return self._drop_locked(document, self._picker.find_instances_at(document, snapshot, x, y))

    @staticmethod
    def _drop_locked(document: Document, ids: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(instance for instance in ids if not document.summarize_instance(instance).is_locked)

    def _count_turns(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Count how often this place was clicked before, without modifier keys and from the same viewpoint."""
        pose = snapshot.camera.world_from_camera.tobytes()
        modified = click.shift or click.ctrl or click.alt
        last, reach = self._last, SAME_PLACE * self._session.state.pixel_scale
        same = last is not None and last[2] == pose and abs(last[0] - click.x) + abs(last[1] - click.y) <= reach
        self._depth = self._depth + 1 if same and not modified and self._session.selection.ids else 0
        self._last = None if modified else (click.x, click.y, pose)
        return self._depth

    def _select(self, instance: int, click: Click) -> None:
        session = self._session
        if instance == 0:
            if not (click.shift or click.ctrl or click.alt):
                session.selection.clear()
        elif click.alt and session.selection.has_codewords:
            session.selection.select_codeword(instance)
        elif click.ctrl:
            session.selection.select((instance,), "remove")
        else:
            session.selection.select((instance,), "add" if click.shift else "replace")
