"""The path of photos, a video or a drive: typed or chosen from a list, and what is found there."""

from __future__ import annotations

import os.path
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from imgui_bundle import ImVec2, imgui

from instdrive_app.files.file_names import is_displayable
from instdrive_app.files.folder_listing import list_folder
from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, get_icon
from instdrive_app.preferences.themes import ERROR
from instdrive_app.session.making.job_controller import SourceLook

_TYPING_SECONDS = 0.4
"""A path is looked at when nothing was typed for so long."""
_STAY = imgui.SelectableFlags_.no_auto_close_popups


class SourceField:
    """A path, what lies beside it, and what it is.

    Args:
        mark: begins the names of its widgets.
        endings: of the files that are listed beside folders.
        build_command: builds the command that looks at a path; by default, what a scene can be made of it is looked at.
    """

    def __init__(
        self,
        mark: str,
        endings: Sequence[str] = (),
        build_command: Callable[[Ui, Path], Sequence[str] | None] = lambda ui, path: None,
    ) -> None:
        self.text = ""
        self._build_command = build_command
        self._mark, self._endings = mark, tuple(endings)
        self._typed_at = 0.0

    @property
    def path(self) -> Path:
        """What the path stands for."""
        return Path(os.path.expanduser(self.text))

    def reset(self, ui: Ui, text: str) -> None:
        """Begin with a path, which is looked at anew."""
        self.text, self._typed_at, ui.session.making.look = text, 0.0, None

    def draw(self, ui: Ui, title: str, rows: float = 6.0, focus: bool = True) -> bool:
        """Draw the path, and the folders and files beside it; returns whether Enter was pressed in the path."""
        imgui.text(translate(title))
        if focus and imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        before = self.text
        entered, self.text = imgui.input_text("##source", before, imgui.InputTextFlags_.enter_returns_true)
        ui.mark(f"{self._mark}.source")
        if self.text != before:
            self._typed_at = time.monotonic()
        path = self.path
        if imgui.begin_child(
            "##entries", ImVec2(0, rows * imgui.get_text_line_height_with_spacing()), imgui.ChildFlags_.borders
        ):
            folder = path if os.path.isdir(path) else path.parent
            if folder.parent != folder and imgui.selectable(f"{get_icon('ICON_FA_ARROW_UP')}   ..", False, _STAY)[0]:
                self._choose(folder.parent)
            for entry in list_folder(folder, self._endings, lambda _: False):
                symbol = get_icon("ICON_FA_FOLDER" if entry.size is None else "ICON_FA_FILM")
                if imgui.selectable(f"{symbol}   {entry.path.name}", entry.path == path, _STAY)[0]:
                    self._choose(entry.path)
                ui.mark(f"{self._mark}.entry.{entry.path.name}")
        imgui.end_child()
        return entered

    def find_look(self, ui: Ui) -> SourceLook | None:
        """What is known of the path, which is looked at once it is no longer typed; None while nothing is."""
        making, path = ui.session.making, self.path
        if making.look is not None and making.look.source == path:
            return making.look
        if time.monotonic() - self._typed_at >= _TYPING_SECONDS and os.path.exists(path) and is_displayable(path):
            making.look_at(path, self._build_command(ui, path))
        return None

    def draw_look(self, ui: Ui, look: SourceLook | None, hint: str, rows: float = 9.0) -> None:
        """Draw what is known of the path, or `hint` where there is nothing to look at."""
        if imgui.begin_child("##facts", ImVec2(0, rows * imgui.get_text_line_height_with_spacing())):
            if look is None:
                draw_dim_text(translate(hint))
            elif not look.is_ready:
                draw_dim_text(translate("Looking at {name}…", name=look.source.name))
            imgui.push_text_wrap_pos(0)
            if look is not None and look.title:
                imgui.text(translate(look.title))
                ui.mark(f"{self._mark}.found")
            for label, text in _order_facts(look.facts) if look is not None else ():
                draw_dim_text(translate(label.strip()))
                imgui.same_line(9 * imgui.get_font_size())
                imgui.text(translate(text))
            if look is not None and look.problem:
                imgui.text_colored(rgba(ERROR), translate(look.problem))
                ui.mark(f"{self._mark}.problem")
            imgui.pop_text_wrap_pos()
        imgui.end_child()

    def _choose(self, path: Path) -> None:
        self.text, self._typed_at = str(path), 0.0


def _order_facts(facts: tuple[tuple[str, str], ...]) -> list[tuple[str, str]]:
    """What the whole source has first, masks at the top; each camera, whose label is indented, after that."""
    return sorted(facts, key=lambda fact: (fact[0].startswith(" "), fact[0] != "masks"))
