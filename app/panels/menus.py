"""Menu bar and keyboard, both derived from the commands."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.action import Action, format_shortcut
from instdrive_app.actions.conditions import QUIET, ask_to_wait, run_or_explain
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, begin_icon_submenu, draw_icon_menu_item
from instdrive_app.preferences.key_presets import PRESETS
from instdrive_app.preferences.themes import DIM, TEXT


def draw_menus(ui: Ui) -> None:
    """Fill the menu bar."""
    waits = ui.session.sketches.shown is not None
    imgui.begin_disabled(waits)
    imgui.push_style_color(imgui.Col_.text, rgba(DIM if waits else TEXT))  # a disabled title looks like the others
    for menu in ui.session.actions.menus:
        opened = imgui.begin_menu(make_label(menu))
        ui.mark(f"menu {menu}")
        if opened:
            for command in ui.session.actions.in_menu(menu):
                if command.separator:
                    imgui.separator()
                _draw_menu_item(ui, command)
            imgui.end_menu()
    imgui.pop_style_color()
    imgui.end_disabled()


def _draw_menu_item(ui: Ui, command: Action) -> None:
    shortcut = format_shortcut(command.shortcuts[0]) if command.shortcuts else ""
    checked = command.checked() if command.checked else False
    if command.items is not None:
        _draw_submenu(ui, command)
    elif draw_icon_menu_item(command.icon, make_label(command.title, command.id), shortcut, checked, command.enabled()):
        run_or_explain(ui.session, command)
    ui.mark(f"menu {command.id}")


def _draw_submenu(ui: Ui, command: Action) -> None:
    assert command.items is not None
    opened = begin_icon_submenu(command.icon, make_label(command.title, command.id), command.enabled())
    ui.mark(f"menu {command.id}")
    if not opened:
        return
    for number, (title, run) in enumerate(command.items()):
        if imgui.menu_item(f"{title}###{number}", "", False)[0]:
            run()
        ui.mark(f"menu {command.id} {number}")
    imgui.end_menu()


def run_shortcuts(ui: Ui) -> None:
    """Run the actions whose keys were pressed in this frame.

    None runs while text is typed, a dialog is open, or a region or handle is dragged, nor by a key that the focused
    panel uses itself.
    """
    ui.keys.update()
    _close_by_escape()
    claimed, ui.claimed_shortcuts = ui.claimed_shortcuts, frozenset()
    io, dragged = imgui.get_io(), ui.tool.outline or ui.session.movement.drag is not None
    if io.want_text_input or dragged or ui.popup_open or imgui.is_popup_open("", imgui.PopupFlags_.any_popup):
        return
    if not PRESETS[ui.session.preferences.current.preset].flies_always and imgui.is_mouse_down(1):
        return  # W A S D fly
    for command in ui.session.actions:
        shortcuts = (shortcut for shortcut in command.shortcuts if shortcut not in claimed)
        if any(ui.keys.is_pressed(shortcut) for shortcut in shortcuts):
            if ui.session.sketches.shown is None:
                run_or_explain(ui.session, command)
            elif not QUIET.intersection(command.shortcuts):
                ask_to_wait(ui.session)


def _close_by_escape() -> None:
    """Close menus and other popups at Escape; modal dialogs take care of themselves and of lists open in them."""
    opened = imgui.is_popup_open("", imgui.PopupFlags_.any_popup)
    if opened and imgui.is_key_pressed(imgui.Key.escape, False) and not imgui.internal.get_top_most_popup_modal():
        imgui.internal.close_popup_to_level(0, True)


def format_action_title(command: Action) -> str:
    """The title in the window's language, and where what the command does cannot be undone, that it cannot."""
    title = translate(command.title)
    return translate("{title}  (cannot be undone)", title=title) if command.undoable is False else title
