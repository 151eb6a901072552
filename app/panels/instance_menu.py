"""The right-click menu of an instance, the same in the viewport and in the list."""

from __future__ import annotations

from collections.abc import Callable

from imgui_bundle import imgui

from instdrive_app.panels.recolor import preset_row
from instdrive_app.panels.ui import Ui, icon_menu_item, swatch


def instance_menu(ui: Ui, instance_id: int) -> None:
    """Menu items for one instance, or for the whole selection where the instance belongs to it."""
    session = ui.session
    document = session.document
    if document is None or instance_id not in document.scene.table:
        return
    ids = session.selected if instance_id in session.selected else (instance_id,)
    instance, hidden = document.scene.table[instance_id], document.instance_flags(instance_id).is_hidden
    swatch(instance)
    imgui.same_line()
    imgui.text(instance.name if len(ids) == 1 else f"{len(ids)} instances")
    imgui.separator()
    _item(ui, "delete", "ICON_FA_TRASH", "Delete", lambda: session.delete(ids))
    if hidden:
        _item(ui, "hide", "ICON_FA_EYE", "Show", lambda: session.hide(ids, hidden=False))
    else:
        _item(ui, "hide", "ICON_FA_EYE_SLASH", "Hide", lambda: session.hide(ids))
    _item(ui, "solo", "ICON_FA_BULLSEYE", "Show only this", lambda: session.solo.toggle(ids))
    _item(ui, "frame", "ICON_FA_EXPAND", "Frame", lambda: session.navigation.frame(ids))
    _item(ui, "rename", "ICON_FA_PEN", "Rename…", lambda: session.ask_name(instance_id))
    if document.scene.code_bits:
        title = f"Select codeword {instance.codeword}"
        _item(ui, "codeword", "ICON_FA_BARCODE", title, lambda: session.select_codeword_of(instance_id))
    imgui.separator()
    if preset_row(ui, "menu", ids):
        imgui.close_current_popup()


def _item(ui: Ui, name: str, symbol: str, title: str, action: Callable[[], None]) -> None:
    if icon_menu_item(symbol, title):
        action()
    ui.mark(f"menu.{name}")
