"""Asks how long the open scene trains on and into which folder, and begins the job."""

from __future__ import annotations

import os.path
from pathlib import Path

from imgui_bundle import ImVec2, imgui

from instdrive_app.files.file_names import is_displayable
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.dialogs.making.job_fields import draw_minutes, propose_run_folder
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.preferences.themes import ERROR
from instdrive_app.session.making.job_controller import find_job_folder_problem
from instdrive_app.session.requests import AskImprove
from instdrive_core.wording import phrase

TITLE = "Improve the scene"
LENGTHS = (("Short", 5.0), ("Good", 15.0), ("Long", 45.0))
"""Names and minutes that are proposed."""


class ImproveDialog:
    """What will happen at the top, minutes and folder below."""

    def __init__(self) -> None:
        self._minutes = LENGTHS[1][1]
        self._name, self._out = "", ""

    def open(self, ui: Ui, request: AskImprove) -> None:
        """Open it, with a new folder for the open scene."""
        path, base = ui.session.files.path, ui.session.improver.base
        self._name = "" if base is None else base.name if path is None else path.stem
        self._out = str(propose_run_folder(f"{self._name.removesuffix(' improved')} improved"))
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(ImVec2(40 * imgui.get_font_size(), 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        imgui.push_text_wrap_pos(0)
        imgui.text(
            translate(
                "{name} is trained on with the photos it was made of. Your edits stay: what was deleted stays deleted, "
                "what was moved or painted stays as it is. The result is a new scene beside the present one.",
                name=self._name,
            )
        )
        imgui.pop_text_wrap_pos()
        imgui.separator()
        self._minutes = draw_minutes(ui, "improve", LENGTHS, self._minutes)
        imgui.text(translate("Folder of the new scene"))
        imgui.set_next_item_width(-1)
        entered, self._out = imgui.input_text("##out", self._out, imgui.InputTextFlags_.enter_returns_true)
        ui.mark("improve.out")
        out = Path(os.path.expanduser(self._out))
        problem = self._find_problem(ui, out)
        if problem:
            imgui.push_text_wrap_pos(0)
            imgui.text_colored(rgba(ERROR), translate(problem))
            imgui.pop_text_wrap_pos()
        if draw_confirm_buttons(ui, "Start", entered, not problem):
            ui.session.improver.begin(out, self._minutes)
        imgui.end_popup()

    def _find_problem(self, ui: Ui, out: Path) -> str:
        if ui.session.improver.obstacle:
            return ui.session.improver.obstacle
        if not self._out.strip() or not is_displayable(out):
            return phrase("Enter the folder of the new scene")
        return find_job_folder_problem(out)
