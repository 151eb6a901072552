"""The part of Preferences with the keys: presets, every command's key, conflicts, export and import."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.action import Action, format_shortcut
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, fit_text, scale_pixels, scale_size
from instdrive_app.preferences.key_presets import PRESETS, find_owner
from instdrive_app.session.requests import AskPath
from instdrive_core.wording import phrase

LABELS, KEYS, HEIGHT = 150.0, 330.0, 190.0
"""Places of columns and height of the list, in pixels at scale 1."""


class KeyList:
    """Lists commands with their keys; a click on one waits for another key, which Escape gives up."""

    def __init__(self) -> None:
        self._query = ""
        self._waiting = ""
        """ID of the action that waits for a key; empty = none."""
        self._conflict: tuple[str, str, str] | None = None
        """A key that was pressed, whose it is, and who was to get it."""
        self.holds_keyboard = False
        """Whether Escape and Enter are meant for the list in this frame."""

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        self.holds_keyboard = bool(self._waiting)
        self._take_key(ui)
        self._draw_presets(ui)
        imgui.set_next_item_width(-1)
        _, self._query = imgui.input_text_with_hint("##find a key", translate("Command or key"), self._query)
        ui.mark("preferences.keys.search")
        if imgui.begin_child("##keys", scale_size(0, HEIGHT), imgui.ChildFlags_.borders):
            for command in ui.session.actions:
                if self._matches(command):
                    self._draw_row(ui, command)
        imgui.end_child()
        self._draw_conflict(ui)
        self._draw_files(ui)

    def _matches(self, command: Action) -> bool:
        keys = (*command.shortcuts, *map(format_shortcut, command.shortcuts))
        names = (command.title, translate(command.title), command.menu, translate(command.menu), *keys)
        text = " ".join(names).lower()
        return all(word in text for word in self._query.lower().split())

    def _draw_presets(self, ui: Ui) -> None:
        kept = ui.session.preferences
        draw_dim_text(translate("Keys and mouse"))
        for name, preset in PRESETS.items():
            imgui.same_line(scale_pixels(LABELS) if name == next(iter(PRESETS)) else 0.0)
            if imgui.radio_button(preset.title, kept.current.preset == name):
                kept.change(preset=name)
            ui.mark(f"preferences.preset.{name}")

    def _draw_row(self, ui: Ui, command: Action) -> None:
        imgui.align_text_to_frame_padding()
        imgui.text(fit_text(translate(command.title), scale_pixels(KEYS - 20)))
        imgui.same_line(scale_pixels(KEYS))
        waits = self._waiting == command.id
        keys = ", ".join(map(format_shortcut, command.shortcuts)) or translate("none")
        text = translate("press keys…") if waits else keys
        if imgui.button(f"{text}###{command.id}", scale_size(130, 0)):
            self._waiting, self._conflict = command.id, None
        ui.mark(f"preferences.key.{command.id}")
        if command.id in ui.session.preferences.current.keys:
            imgui.same_line()
            if imgui.small_button(make_label("Reset", f"reset {command.id}")):
                own = ui.session.preferences.current.keys
                ui.session.preferences.change(keys={name: keys for name, keys in own.items() if name != command.id})
            ui.mark(f"preferences.key.{command.id}.reset")

    def _take_key(self, ui: Ui) -> None:
        if not self._waiting:
            return
        if imgui.is_key_pressed(imgui.Key.escape, False):
            self._waiting = ""
            return
        pressed = ui.keys.read()
        if pressed is None:
            return
        owner = find_owner({command.id: command.shortcuts for command in ui.session.actions}, pressed, self._waiting)
        if owner is None:
            _give(ui, self._waiting, pressed)
        else:
            self._conflict = (pressed, owner, self._waiting)
        self._waiting = ""

    def _draw_conflict(self, ui: Ui) -> None:
        if self._conflict is None:
            return
        key, owner, wanted = self._conflict
        commands = ui.session.actions
        imgui.text_wrapped(
            translate("{key} is the key of “{title}”.", key=format_shortcut(key), title=phrase(commands[owner].title))
        )
        if imgui.button(make_label("Give it to “{title}”", title=phrase(commands[wanted].title))):
            left = tuple(held for held in commands[owner].shortcuts if held != key)
            kept = ui.session.preferences
            kept.change(keys={**kept.current.keys, owner: left, wanted: (key,)})
            self._conflict = None
        ui.mark("preferences.conflict.take")

    def _draw_files(self, ui: Ui) -> None:
        ways = ("Export keys…", AskPath("export_keys"), "export"), ("Import keys…", AskPath("import_keys"), "import")
        for title, request, mark in ways:
            if imgui.button(make_label(title)):
                ui.session.requests.put(request)
                imgui.close_current_popup()
            ui.mark(f"preferences.keys.{mark}")
            imgui.same_line()
        if imgui.button(make_label("Reset all keys")):
            ui.session.preferences.change(keys={})
        ui.mark("preferences.keys.reset")


def _give(ui: Ui, action_id: str, key: str) -> None:
    kept = ui.session.preferences
    kept.change(keys={**kept.current.keys, action_id: (key,)})
