"""The keys of the selected thing's way on the map, which can be dragged and added there."""

from __future__ import annotations

import numpy as np

from instdrive_app.panels.map.canvas import MapCanvas
from instdrive_app.panels.overlays.path_keys import KEY, draw_key
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Ui, scale_pixels
from instdrive_app.preferences.themes import PICTURE_ACCENT, PICTURE_SHADE, PICTURE_TEXT
from instdrive_app.session.driving.path_hits import KEY_PIXELS, WAY_PIXELS
from instdrive_core.scene.ways.way_keys import find_time_at, move_key


class WayLayer:
    """Shown with the path tool; a drag moves a key, a click on the way adds one, a click on the ground goes on."""

    def __init__(self) -> None:
        self._held: int | None = None
        """Index of the key that is held; None while the press is elsewhere."""

    def draw(self, ui: Ui, canvas: MapCanvas) -> None:
        """Draw one frame."""
        editor = ui.session.ways
        if not editor.is_active:
            return
        line = editor.find_line()
        canvas.draw_path(line, pack_color(PICTURE_SHADE, 0.7), 5.0)
        canvas.draw_path(line, pack_color(PICTURE_ACCENT), 2.5)
        ghost = editor.find_ghost()
        if ghost is not None:
            canvas.draw_path(ghost, pack_color(PICTURE_TEXT), 1.5, closed=True)
        if not editor.drives:
            return
        for index, key in enumerate(editor.keys):
            (spot,) = canvas.to_screen(np.array([(key.x, key.y)]))
            draw_key((spot.x, spot.y), index == editor.chosen)
            ui.mark_spot(f"gizmo.map.way.{index}", (spot.x, spot.y), KEY, canvas.place)

    def press(self, ui: Ui, canvas: MapCanvas) -> bool:
        """Take the key under the mouse."""
        editor = ui.session.ways
        if not editor.is_active or not editor.drives:
            return False
        apart = [canvas.measure_to_mouse((key.x, key.y)) for key in editor.keys]
        nearest = int(np.argmin(apart))
        if apart[nearest] > scale_pixels(KEY_PIXELS):
            return False
        self._held = nearest
        editor.choose(nearest)
        return True

    def drag(self, ui: Ui, canvas: MapCanvas, is_moved: bool) -> None:
        """Put the held key where the mouse is."""
        editor = ui.session.ways
        if is_moved and self._held is not None and self._held < len(editor.keys):
            editor.preview(move_key(editor.keys, self._held, *canvas.find_mouse()))

    def release(self, ui: Ui, canvas: MapCanvas, is_moved: bool) -> None:
        """Let the thing drive through the key's new place."""
        self._held = None
        ui.session.ways.finish()

    def click(self, ui: Ui, canvas: MapCanvas, thing: int) -> bool:
        """Add a key on the way, or let the way go on to the mouse; returns whether the click was for that.

        `thing` is what stands or drives there, 0 for nothing: a click on another one selects it.
        """
        editor = ui.session.ways
        if not editor.is_active:
            return False
        place = canvas.find_mouse()
        if editor.drives and len(editor.keys) > 1:
            time, apart = find_time_at(editor.keys, *place)
            if apart / canvas.window.scale <= scale_pixels(WAY_PIXELS):
                editor.add(time)
                return True
        if thing:
            return thing == editor.subject
        editor.extend(*place)
        return True
