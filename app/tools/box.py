"""The tool of the box: a click places it, drags of its handles change it, commands use it."""

from __future__ import annotations

from instdrive_app.pointer import Click, Point
from instdrive_app.render.picking import Picker
from instdrive_app.session.aids.box_handles import drag_handle, find_handle
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.selection_box import Box
from instdrive_app.state import FrameSnapshot
from instdrive_app.tools.pick import PickTool
from instdrive_app.tools.surface import WinnerReader, find_surface

REACH = 14.0
"""Pixels at scale 1 around a handle within which a press grasps it."""


class BoxTool(PickTool):
    """Places the box by a click: around an object, or where nothing is known to be one.

    A press on a handle drags the face or the box; any other drag moves the camera.
    """

    options: tuple[str, ...] = (
        "tool.whole_instances",
        "tool.single_splats",
        "box.select",
        "box.select_outside",
        "box.crop",
        "box.delete_outside",
        "box.turn_left",
        "box.turn_right",
        "box.remove",
    )

    def __init__(self, session: EditorSession, winners: WinnerReader, picker: Picker | None = None) -> None:
        super().__init__(session, picker)
        self._winners = winners
        self._snapshot: FrameSnapshot | None = None
        self._grasped: tuple[str, Box, FrameSnapshot] | None = None
        self._handle: str | None = None

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """See whether a handle is under the pointer; elsewhere hover like the pick tool."""
        box = self._session.aids.box.box
        self._snapshot = snapshot
        self._handle = None if box is None else self._find_handle(box, snapshot, (x, y))
        self.drags = self._handle is not None
        if self.drags:
            super().leave()
        else:
            super().hover(x, y, snapshot)

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Place the box at what is under the pointer; returns its instance, 0 for none."""
        document, controller = self._session.document, self._session.aids.box
        box = controller.box
        on_handle = box is not None and self._find_handle(box, snapshot, (click.x, click.y)) is not None
        if document is None or on_handle or click.double:
            return 0
        found = find_surface(document, self._winners, snapshot, click.x, click.y)
        if found is None:
            self._session.messages.info("There is nothing here to put a box around; click something solid")
            return 0
        instance = int(document.scene.instance_ids[found.row])
        controller.place(found.place, found.distance, instance)
        return instance

    def drag(self, start: Point, to: Point) -> None:
        """Drag the handle on which the press began."""
        controller = self._session.aids.box
        if self._grasped is None:
            if controller.box is None or self._snapshot is None:
                return
            handle = self._handle or self._find_handle(controller.box, self._snapshot, start)
            if handle is None:
                return
            controller.begin_drag()
            self._grasped = handle, controller.box, self._snapshot
        handle, box, snapshot = self._grasped
        controller.change(drag_handle(box, handle, snapshot.camera, start, to))

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """Leave the box as it is now."""
        self._grasped = None

    def cancel(self) -> None:
        """Give the box back the shape that it had before the drag."""
        if self._grasped is not None:
            self._session.aids.box.change(self._grasped[1])
        self._grasped = None

    def _find_handle(self, box: Box, snapshot: FrameSnapshot, at: Point) -> str | None:
        return find_handle(box, snapshot.camera, at, REACH * self._session.state.pixel_scale)
