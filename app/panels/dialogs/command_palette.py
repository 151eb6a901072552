"""The command palette: finds any action by a few letters of its name."""

from __future__ import annotations

from collections.abc import Iterable

from imgui_bundle import ImVec2, imgui

from instdrive_app.action import Action, format_shortcut
from instdrive_app.actions.conditions import explain_disabled, run_or_explain
from instdrive_app.language.translation import translate
from instdrive_app.matching import find_best_matches
from instdrive_app.panels.menus import format_action_title
from instdrive_app.panels.widgets.theme import pack_color, rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, get_icon, scale_pixels
from instdrive_app.preferences.themes import DIM, ERROR, TEXT
from instdrive_app.session.requests import ShowPalette
from instdrive_core.wording import drop_ellipsis, phrase

TITLE = "Command palette"
POPUP = "##palette"
"""ID of the popup, which has no title bar."""
ROWS = 11
ELSEWHERE = {
    "train": "Training runs in a terminal: instdrive train",
    "training": "Training runs in a terminal: instdrive train",
}
"""Words for what the editor cannot do, and who can."""


class CommandPalette:
    """Lists the actions that match what is typed; arrow keys or the mouse choose one, Enter runs it."""

    def __init__(self) -> None:
        self._typed, self._reason = "", ""
        self._chosen = 0
        self._types_on = False
        """Whether the search field gets the keyboard back."""

    def open(self, ui: Ui, request: ShowPalette) -> None:
        """Open it, with nothing typed."""
        self._typed, self._chosen, self._reason = "", 0, ""
        imgui.open_popup(POPUP)

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        viewport, em = imgui.get_main_viewport(), imgui.get_font_size()
        imgui.set_next_window_pos(
            ImVec2(viewport.get_center().x, viewport.pos.y + 5 * em), imgui.Cond_.always, ImVec2(0.5, 0)
        )
        imgui.set_next_window_size(ImVec2(36 * em, 0))
        if not imgui.begin_popup(POPUP, imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_move):
            return
        run = self._draw_search(ui)
        found = _list_matches(self._typed, ui.session.actions)
        self._move_cursor(len(found))
        clicked = self._draw_list(ui, found)
        if clicked is None and run and found:
            clicked = found[self._chosen]
        if clicked is not None and clicked.enabled():
            imgui.close_current_popup()
            run_or_explain(ui.session, clicked)
        elif clicked is not None:
            self._reason = phrase(
                "{command}: {reason}",
                command=drop_ellipsis(clicked.title),
                reason=explain_disabled(ui.session, clicked),
            )
            self._types_on = True
        self._draw_reason(ui)
        imgui.end_popup()

    def _draw_reason(self, ui: Ui) -> None:
        """Say why the command that was chosen last cannot run."""
        if self._reason:
            imgui.push_text_wrap_pos(0)
            imgui.text_colored(rgba(ERROR), translate(self._reason))
            imgui.pop_text_wrap_pos()
            ui.mark("palette.reason")

    def _draw_search(self, ui: Ui) -> bool:
        if imgui.is_window_appearing() or self._types_on:
            imgui.set_keyboard_focus_here()
            self._types_on = False
        imgui.set_next_item_width(-1)
        hint = f"{get_icon('ICON_FA_MAGNIFYING_GLASS')}  {translate('What do you want to do?')}"
        before = self._typed
        entered, self._typed = imgui.input_text_with_hint(
            "##typed", hint, self._typed, imgui.InputTextFlags_.enter_returns_true
        )
        ui.mark("palette.search")
        if self._typed != before:
            self._chosen, self._reason = 0, ""
        return entered

    def _move_cursor(self, count: int) -> None:
        step = imgui.is_key_pressed(imgui.Key.down_arrow) - imgui.is_key_pressed(imgui.Key.up_arrow)
        self._chosen = (self._chosen + step) % count if count else 0
        self._walked = step != 0

    def _draw_list(self, ui: Ui, found: list[Action]) -> Action | None:
        clicked, line = None, imgui.get_text_line_height_with_spacing()
        if imgui.begin_child("##found", ImVec2(0, ROWS * line)):
            elsewhere = ELSEWHERE.get(self._typed.strip().lower(), "" if found else "No command matches")
            if elsewhere:
                draw_dim_text(translate(elsewhere))
            for number, command in enumerate(found):
                if self._draw_row(ui, command, number == self._chosen):
                    clicked = command
                if number == self._chosen and self._walked:
                    imgui.set_scroll_here_y(0.5)
        imgui.end_child()
        return clicked

    def _draw_row(self, ui: Ui, command: Action, chosen: bool) -> bool:
        at, em, width = imgui.get_cursor_screen_pos(), imgui.get_font_size(), imgui.get_content_region_avail().x
        flags = imgui.SelectableFlags_.no_auto_close_popups
        clicked = imgui.selectable(f"##{command.id}", chosen, flags)[0]
        ui.mark(f"palette.{command.id}")
        color, draw = pack_color(TEXT if command.enabled() else DIM), imgui.get_window_draw_list()
        glyph = get_icon(command.icon)
        draw.add_text(ImVec2(at.x + (1.4 * em - imgui.calc_text_size(glyph).x) / 2, at.y), color, glyph)
        draw.add_text(ImVec2(at.x + 2 * em, at.y), color, format_action_title(command))
        keys = format_shortcut(command.shortcuts[0]) if command.shortcuts else ""
        draw.add_text(
            ImVec2(at.x + width - imgui.calc_text_size(keys).x - scale_pixels(4), at.y), pack_color(DIM), keys
        )
        menu = translate(command.menu)
        place = at.x + width - 8 * em - imgui.calc_text_size(menu).x
        draw.add_text(ImVec2(place, at.y), pack_color(DIM, 0.75), menu)
        return clicked


def _list_english_words(action: Action) -> tuple[str, ...]:
    """Words of the English title, by which manuals name the command; none where the window speaks English."""
    return () if translate(action.title) == action.title else (action.title.lower(), *action.title.lower().split())


def _list_matches(typed: str, actions: Iterable[Action]) -> list[Action]:
    """The actions of the menus that match, best first; once letters are typed, those that cannot run now come last.

    So Enter runs the best match that can run.
    """
    found = find_best_matches(
        typed,
        (action for action in actions if action.menu),
        lambda action: translate(action.title),
        lambda action: translate(action.menu),
        lambda action: (
            *(translate(word).lower() for word in action.words),
            *action.words,
            *_list_english_words(action),
        ),
    )
    return sorted(found, key=lambda action: not action.enabled()) if typed else found
