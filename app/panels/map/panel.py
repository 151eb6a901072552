"""The scene from straight above, beside the view: picture, tracks, boxes, the recording car's way, the view's cone."""

from __future__ import annotations

from weakref import ref

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import Float64, UInt8
from numpy import ndarray

from instdrive_app.language.translation import translate
from instdrive_app.panels.map.canvas import MapCanvas, MapLayer
from instdrive_app.panels.map.ego_layer import EgoLayer
from instdrive_app.panels.map.things import draw_movers, draw_view, draw_way
from instdrive_app.panels.map.way_layer import WayLayer
from instdrive_app.panels.widgets.theme import look_up, pack_color
from instdrive_app.panels.widgets.ui import (
    Rectangle,
    Ui,
    draw_action_button,
    draw_dim_text,
    fit_text,
    get_icon,
    scale_pixels,
    scale_size,
)
from instdrive_app.pointer import choose_selection_mode
from instdrive_app.preferences.themes import BACKGROUND, PICTURE_ACCENT
from instdrive_app.session.mapping.map_picture import MapPicture, mark_instances
from instdrive_app.session.mapping.map_things import MapThing, find_at, find_extent, list_map_things
from instdrive_app.session.mapping.map_window import MapWindow, fit_map
from instdrive_app.session.requests import ShowPanel
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.compact_objects import is_compact
from instdrive_core.wording import count_phrase, phrase

DRAG_PIXELS = 4.0
"""A press that moves farther than this is a drag, not a click; pixels at scale 1."""
ZOOM = 0.85
"""Share of the metres to a pixel that is left after a notch of the wheel."""
LEAST_CAR = 9.0
"""Length of the recording car's arrow, pixels at scale 1, where 2 m are less."""


class MapPanel:
    """The wheel zooms, a drag pans, a click selects the thing there, a double click moves the view there."""

    def __init__(self) -> None:
        self._window: MapWindow | None = None
        self._document: ref[Document] | None = None
        self._layers: tuple[MapLayer, ...] = (EgoLayer(), WayLayer())
        """The first one is on top and gets the mouse first."""
        self._held: MapLayer | None = None
        """The layer that has taken the present press."""
        self._pressed = (0.0, 0.0)
        self._is_moved = self._is_double = False
        """Whether the present press is a drag, and whether it is the second of a double click."""
        self._things: tuple[object, tuple[MapThing, ...]] = (None, ())
        self._marked: tuple[object, UInt8[ndarray, "h w 4"]] | None = None
        self._fitted = 0
        """Number of the request to show everything that was followed last."""

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        document = ui.session.document
        if document is None:
            imgui.text_disabled(translate("No scene is open."))
            return
        things = self._list_things(document, ui.session.state.time)
        self._draw_head(ui, things)
        at, room = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail()
        place = Rectangle(at.x, at.y, max(int(room.x), 16), max(int(room.y), 16))
        if not self._choose_window(ui, document, things, place):
            imgui.text_disabled(translate("Nothing is left of the scene to show."))
            return
        imgui.invisible_button(
            "##map",
            ImVec2(place.width, place.height),
            imgui.ButtonFlags_.mouse_button_left
            | imgui.ButtonFlags_.mouse_button_right
            | imgui.ButtonFlags_.mouse_button_middle,
        )
        ui.mark("map.canvas")
        canvas = self._use_mouse(ui, place, things)
        self._window = canvas.window
        ui.session.map.update(canvas.window, imgui.get_io().delta_time)
        self._paint(ui, canvas, things)

    def _list_things(self, document: Document, time: float) -> tuple[MapThing, ...]:
        versions = document.versions
        key = (ref(document), time, versions.tracks, versions.states, versions.table)
        if self._things[0] != key:
            self._things = (key, list_map_things(document, time))
        return self._things[1]

    def _draw_head(self, ui: Ui, things: tuple[MapThing, ...]) -> None:
        draw_action_button(ui, ui.session.actions["map.frame"], scale_size(30, 0))
        imgui.same_line()
        way = ui.session.cameras.trace_way()
        if way is not None:
            names = ("ego.draw", "ego.drop_last", "ego.clear") if ui.session.ego_way.is_drawing else ("ego.draw",)
            for name in names:
                draw_action_button(ui, ui.session.actions[name], scale_size(30, 0))
                imgui.same_line()
        moving = sum(len(thing.path) > 0 for thing in things)
        if ui.session.ego_way.is_drawing:
            text = phrase("Click to set places")
        elif moving:
            text = count_phrase(moving, "{count} moving thing", "{count} moving things")
        elif way is None:
            text = phrase("No tracks and no drive: just the picture")
        else:
            text = phrase("The recording car's way; nothing else moves")
        close, gap = scale_pixels(30), imgui.get_style().item_spacing.x
        left = imgui.get_cursor_screen_pos()
        room = imgui.get_content_region_avail().x
        draw_dim_text(fit_text(translate(text), room - close - gap))
        imgui.same_line()
        imgui.set_cursor_screen_pos(ImVec2(left.x + room - close, left.y))
        if imgui.button(f"{get_icon('ICON_FA_XMARK')}##close", scale_size(30, 0)):
            ui.session.requests.put(ShowPanel("Map", closes=True))
        ui.mark("map.close")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("Close the map"))

    def _choose_window(self, ui: Ui, document: Document, things: tuple[MapThing, ...], place: Rectangle) -> bool:
        """Keep the window, in the panel's size; or fit it to a scene that was just opened. False: nothing is there."""
        asked = ui.session.state.map_fits
        known = self._document is not None and self._document() is document and self._fitted == asked
        if known and self._window is not None:
            self._window = self._window.resize(place.width, place.height)
            return True
        extent = find_extent(document, things, ui.session.cameras.trace_way())
        if extent is None:
            return False
        self._window, self._document, self._fitted = fit_map(extent, place.width, place.height), ref(document), asked
        return True

    # ------------------------------------------------------------------ mouse

    def _use_mouse(self, ui: Ui, place: Rectangle, things: tuple[MapThing, ...]) -> MapCanvas:
        """Zoom, pan, click, or let a layer follow the mouse; returns the canvas after that."""
        assert self._window is not None
        io, canvas = imgui.get_io(), MapCanvas(self._window, place)
        x, y = io.mouse_pos.x - place.x, io.mouse_pos.y - place.y
        if imgui.is_item_hovered() and io.mouse_wheel:
            canvas = MapCanvas(canvas.window.zoom(ZOOM**io.mouse_wheel, x, y), place)
        if imgui.is_item_activated():
            self._pressed, self._is_moved = (io.mouse_pos.x, io.mouse_pos.y), False
            self._is_double = imgui.is_mouse_double_clicked(0)
            is_left = imgui.is_mouse_down(0)
            self._held = next((layer for layer in self._layers if is_left and layer.press(ui, canvas)), None)
        if imgui.is_item_active():
            apart = abs(io.mouse_pos.x - self._pressed[0]) + abs(io.mouse_pos.y - self._pressed[1])
            self._is_moved = self._is_moved or apart > scale_pixels(DRAG_PIXELS)
            if self._held is not None:
                self._held.drag(ui, canvas, self._is_moved)
            elif self._is_moved:
                canvas = MapCanvas(canvas.window.drag(io.mouse_delta.x, io.mouse_delta.y), place)
        if imgui.is_item_deactivated():
            if self._held is not None:
                self._held.release(ui, canvas, self._is_moved)
            elif not self._is_moved and imgui.is_mouse_released(0):
                self._click(ui, canvas, things)
            self._held = None
        if imgui.is_item_hovered() and not imgui.is_item_active():
            ui.session.state.hovered = self._find_thing(ui, canvas, things)
        return canvas

    def _click(self, ui: Ui, canvas: MapCanvas, things: tuple[MapThing, ...]) -> None:
        """Select the thing under the mouse; or move the view there, at the second click of a double click."""
        io = imgui.get_io()
        if self._is_double:
            ui.session.navigation.go_to_place(*canvas.find_mouse())
            return
        found = self._find_thing(ui, canvas, things)
        if any(layer.click(ui, canvas, found) for layer in self._layers):
            return
        ui.session.selection.select((found,) if found else (), choose_selection_mode(io.key_shift, io.key_ctrl))

    def _find_thing(self, ui: Ui, canvas: MapCanvas, things: tuple[MapThing, ...]) -> int:
        """Find what stands or drives under the mouse; 0 where there is only ground, or nothing."""
        document, picture, place = ui.session.document, ui.session.map.picture, canvas.find_mouse()
        assert document is not None
        found = find_at(things, *place)
        if not found and picture is not None:
            x, y = picture.window.to_pixels(np.array([place]))[0].tolist()
            if 0 <= x < picture.window.width and 0 <= y < picture.window.height:
                found = int(picture.ids[int(y), int(x)])
        if not found or found not in document.scene.table:
            return 0
        summary = document.summarize_instance(found)
        is_thing = bool(document.scene.table[found].node) or is_compact(document.scene.table[found])
        return found if is_thing and summary.drawn and not summary.is_locked else 0

    # ------------------------------------------------------------------ drawing

    def _paint(self, ui: Ui, canvas: MapCanvas, things: tuple[MapThing, ...]) -> None:
        draw, place = imgui.get_window_draw_list(), canvas.place
        low, high = ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height)
        draw.push_clip_rect(low, high, True)
        draw.add_rect_filled(low, high, pack_color(BACKGROUND))
        picture = ui.session.map.picture
        if picture is not None:
            self._draw_picture(ui, canvas, picture)
        draw_way(canvas, ui.session.cameras.trace_way(), self._place_car(ui, canvas))
        draw_movers(ui, canvas, things)
        draw_view(ui, canvas)
        for layer in reversed(self._layers):
            layer.draw(ui, canvas)
        draw.pop_clip_rect()

    def _draw_picture(self, ui: Ui, canvas: MapCanvas, picture: MapPicture) -> None:
        """Draw the last picture where its part of the ground is now, with what is selected marked."""
        selected = ui.session.selection.ids
        key = (id(picture), selected)
        if self._marked is None or self._marked[0] != key:
            color = tuple(round(255 * part) for part in look_up(PICTURE_ACCENT))
            self._marked = (key, mark_instances(picture, selected, (color[0], color[1], color[2])))
        window = picture.window
        corners = np.array([window.to_place(0, 0), window.to_place(window.width, window.height)])
        low, high = canvas.to_screen(corners)
        texture = imgui.ImTextureRef(ui.textures.show("map", self._marked[1]))
        imgui.get_window_draw_list().add_image(texture, low, high)

    def _place_car(self, ui: Ui, canvas: MapCanvas) -> Float64[ndarray, "2 2"] | None:
        """Place the recording car's arrow at the present time; None where there is no drive."""
        pose = ui.session.cameras.find_car(ui.session.state.time)
        if pose is None:
            return None
        ahead = pose[:2, 1] / max(float(np.linalg.norm(pose[:2, 1])), 1e-9)
        length = max(2.0, scale_pixels(LEAST_CAR) * canvas.window.scale)
        return np.stack([pose[:2, 3], pose[:2, 3] + length * ahead])
