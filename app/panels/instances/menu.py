"""The context menu of an instance, the same in the viewport and in the list."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.action import format_shortcut
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.inspector.recolor import draw_preset_row
from instdrive_app.panels.widgets.ui import (
    Ui,
    begin_icon_submenu,
    draw_icon_menu_item,
    draw_swatch,
    fit_text,
    scale_pixels,
)
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskClass, AskName, AskSplit
from instdrive_core.edits.document.document import Document
from instdrive_core.wording import format_count, phrase

Ids = tuple[int, ...]

WIDEST = 260.0
"""Pixels, at scale 1, that a name may take."""


def draw_instance_menu(ui: Ui, instance_id: int) -> None:
    """Draw the menu's items for one instance, or for the whole selection if the instance is part of it."""
    document = ui.session.document
    if document is None or instance_id not in document.scene.table:
        return
    ids = ui.session.selection.ids if instance_id in ui.session.selection.ids else (instance_id,)
    instance = document.scene.table[instance_id]
    draw_swatch(ui, instance)
    imgui.same_line()
    many = translate(format_count(len(ids), "instance"))
    imgui.text(fit_text(instance.name, scale_pixels(WIDEST)) if len(ids) == 1 else many)
    imgui.separator()
    locked = _is_locked(document, ids)
    _draw_visibility(ui, document, ids, locked)
    imgui.separator()
    imgui.begin_disabled(locked)
    _draw_names(ui, document, instance_id, ids)
    imgui.end_disabled()
    _draw_kinds(ui, document, instance_id)
    imgui.separator()
    imgui.begin_disabled(locked)
    _draw_repairs(ui, document, instance_id, ids)
    imgui.separator()
    _draw_item(ui, "reset", "edit.reset_colors", "Reset colours", lambda: ui.session.colors.reset(ids))
    imgui.dummy(ImVec2(0, 1))
    if draw_preset_row(ui, "menu", ids):
        imgui.close_current_popup()
    imgui.end_disabled()


def _is_locked(document: Document, ids: Ids) -> bool:
    counts = document.count_states()
    chosen = np.isin(counts.ids, ids)
    return bool((counts.locked >= counts.count - counts.deleted)[chosen].all())


def _draw_visibility(ui: Ui, document: Document, ids: Ids, locked: bool) -> None:
    session = ui.session
    counts = document.count_states()
    hidden = not counts.drawn[np.isin(counts.ids, ids)].any()
    solo = set(ids) == set(session.visibility.solo.ids)
    _draw_item(ui, "delete", "edit.delete", "Delete", lambda: _delete(session, ids), not locked)
    _draw_item(ui, "hide", "edit.hide", "Show" if hidden else "Hide", lambda: session.visibility.hide(ids, not hidden))
    _draw_item(
        ui, "lock", "edit.lock", "Unlock" if locked else "Lock", lambda: session.visibility.lock(ids, not locked)
    )
    _draw_item(
        ui,
        "solo",
        "edit.solo",
        "Show all again" if solo else "Show only this",
        lambda: session.visibility.solo.toggle(ids),
    )
    _draw_item(ui, "frame", "view.frame", "Frame", lambda: session.navigation.frame(ids))


def _delete(session: EditorSession, ids: Ids) -> None:
    if ids == session.selection.ids:  # as the key does: of a part of an instance no more than the part
        session.deletion.delete_selection()
    else:
        session.deletion.delete(ids)


def _draw_names(ui: Ui, document: Document, instance_id: int, ids: Ids) -> None:
    session = ui.session
    if len(ids) == 1:
        _draw_item(ui, "rename", "edit.rename", "Rename…", lambda: session.requests.put(AskName(instance_id)))
    opened = begin_icon_submenu("ICON_FA_TAG", make_label("Set class"))
    ui.mark("menu.classes")
    if opened:
        for name in session.labels.list_classes():
            title = f"{fit_text(name, scale_pixels(WIDEST))}##{name}"
            if imgui.menu_item(title, "", all(document.scene.table[i].class_name == name for i in ids))[0]:
                session.labels.set_class(ids, name)
            ui.mark(f"menu.class.{name}")
        imgui.separator()
        if imgui.menu_item(make_label("Other…"), "", False)[0]:
            session.requests.put(AskClass(ids))
        ui.mark("menu.class")
        imgui.end_menu()


def _draw_kinds(ui: Ui, document: Document, instance_id: int) -> None:
    session, instance = ui.session, document.scene.table[instance_id]
    name = fit_text(instance.class_name, scale_pixels(WIDEST / 2))
    title = phrase("Select class {name}", name=name) if name else phrase("Select instances without a class")
    _draw_item(
        ui,
        "select_class",
        "select.class",
        title,
        lambda: session.selection.select_class(instance.class_name),
    )
    if document.scene.code_bits:
        title = phrase("Select codeword {codeword}", codeword=instance.codeword)
        _draw_item(ui, "codeword", "select.codeword", title, lambda: session.selection.select_codeword(instance_id))


def _draw_repairs(ui: Ui, document: Document, instance_id: int, ids: Ids) -> None:
    session = ui.session
    if len(ids) > 1:
        title = phrase("Merge {count} instances into this", count=len(ids))
        _draw_item(ui, "merge", "labels.merge", title, lambda: session.labels.merge(ids, instance_id))
    else:
        _draw_item(
            ui, "split", "labels.split", "Split by component…", lambda: session.requests.put(AskSplit(instance_id))
        )
    _draw_item(ui, "absorb", "labels.absorb", "Absorb floaters", lambda: session.labels.absorb(ids))
    if session.selection.ids and instance_id not in session.selection.ids:
        title = "Assign the selected splats to this"
        _draw_item(ui, "reassign", "labels.reassign", title, lambda: session.labels.reassign(instance_id))


def _draw_item(
    ui: Ui, name: str, command_id: str, title: str, action: Callable[[], None], enabled: bool = True
) -> None:
    """Draw an item that runs `action` on the menu's instances, with the icon and shortcut of a registered action."""
    command = ui.session.actions[command_id]
    shortcut = format_shortcut(command.shortcuts[0]) if command.shortcuts else ""
    if draw_icon_menu_item(command.icon, make_label(title, name), shortcut, enabled=enabled):
        action()
    ui.mark(f"menu.{name}")
