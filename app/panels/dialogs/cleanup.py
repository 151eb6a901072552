"""Offers to remove odd splats that were found when a scene was opened."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, scale_pixels
from instdrive_app.session.requests import OfferCleanup
from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.scene.lint import HARMFUL

TITLE = "Odd splats"


class CleanupDialog:
    """Lists the kinds of odd splats with a checkbox each; removal is one step that can be undone."""

    def __init__(self) -> None:
        self._chosen: dict[str, bool] = {}

    def open(self, ui: Ui, request: OfferCleanup) -> None:
        """Open it with the harmful kinds ticked."""
        self._chosen = {defect.kind: defect.kind in HARMFUL for defect in ui.session.files.defects}
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        em = imgui.get_font_size()
        center_next_window(ImVec2(38 * em, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        defects = ui.session.files.defects
        imgui.text_wrapped(
            translate("Some splats of this scene may look like haze or spikes, or trouble other programs.")
        )
        imgui.spacing()
        for defect in defects:
            _, self._chosen[defect.kind] = imgui.checkbox(f"##{defect.kind}", self._chosen.get(defect.kind, False))
            ui.mark(f"cleanup.{defect.kind}")
            imgui.same_line()
            imgui.push_text_wrap_pos(0)
            imgui.text(translate(defect.what))
            imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + imgui.get_frame_height() + scale_pixels(8))
            draw_dim_text(translate(defect.remedy))
            imgui.pop_text_wrap_pos()
        rows = [defect.rows for defect in defects if self._chosen.get(defect.kind)]
        if draw_confirm_buttons(ui, "Remove", False, any(map(len, rows)), cancel="Keep all"):
            ui.session.history.apply(DeleteRows(np.unique(np.concatenate(rows))))
        imgui.end_popup()
