"""The tool that edits the way of what is selected: drags of its keys on the ground, and clicks that add some."""

from __future__ import annotations

from instdrive_app.pointer import Click, Point
from instdrive_app.render.picking import Picker
from instdrive_app.session.driving.path_hits import WAY_PIXELS, find_key_at, find_on_ground, measure_to_way
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import FrameSnapshot
from instdrive_app.tools.pick import PickTool
from instdrive_core.edits.queries.compact_objects import is_compact
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.ways.way_keys import find_time_at, move_key


class PathTool(PickTool):
    """A click on a thing selects it. A drag moves a key; a click on the way adds one, elsewhere on the ground goes on.

    While the mouse is at no key, drags move the camera.
    """

    options: tuple[str, ...] = ("way.add", "way.delete", "way.panel")

    def __init__(self, session: EditorSession, picker: Picker | None = None) -> None:
        super().__init__(session, picker)
        self._held: int | None = None
        """Index of the key that is dragged."""
        self._snapshot: FrameSnapshot | None = None

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """Take the next drag where the mouse is at a key."""
        editor = self._session.ways
        self._snapshot = snapshot
        self.drags = editor.is_active and editor.drives and self._find_key(snapshot.camera, x, y) is not None
        if self.drags:
            self._session.state.hovered = 0
        else:
            super().hover(x, y, snapshot)

    def drag(self, start: Point, to: Point) -> None:
        """Put the key under the start of the drag where the mouse is on the ground."""
        editor = self._session.ways
        if not editor.is_active or self._snapshot is None:
            return
        camera = self._snapshot.camera
        if self._held is None:
            self._held = self._find_key(camera, *start)
            editor.choose(self._held)
        if self._held is None or self._held >= len(editor.keys):
            return
        place = find_on_ground(camera, editor.find_ground(editor.keys[self._held].time), *to)
        if place is not None:
            editor.preview(move_key(editor.keys, self._held, *place))

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """Let the thing drive through the key's new place."""
        self._session.ways.finish()

    def cancel(self) -> None:
        """Give the drag up."""
        self._held = None
        self._session.ways.cancel()

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Choose a key, select a thing, add a key on the way, or let the way go on to this place."""
        editor, document = self._session.ways, self._session.document
        if document is None or not editor.is_active or click.double:
            return super().click(click, snapshot)
        camera, keys = snapshot.camera, editor.keys
        index = self._find_key(camera, click.x, click.y)
        if index is not None:
            editor.choose(index)
            return editor.subject
        place = find_on_ground(camera, editor.find_ground(keys[-1].time), click.x, click.y)
        apart = measure_to_way(editor, camera, click.x, click.y)
        if place is not None and editor.drives and apart <= WAY_PIXELS * self._session.state.pixel_scale:
            editor.add(find_time_at(keys, *place)[0])
            return editor.subject
        found = self._find_first(click.x, click.y, snapshot)
        is_thing = found and (document.scene.table[found].node or is_compact(document.scene.table[found]))
        if place is None or click.shift or click.ctrl or click.alt or (is_thing and found != editor.subject):
            return super().click(click, snapshot)
        if found != editor.subject:
            editor.extend(*place)
        return editor.subject

    def _find_key(self, camera: Camera, x: float, y: float) -> int | None:
        return find_key_at(self._session.ways, camera, x, y, self._session.state.pixel_scale)
