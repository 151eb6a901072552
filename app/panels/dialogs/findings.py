"""What is odd about a scene's splats, told when it is opened, and offered for removal."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, scale_pixels
from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.scene.lint import HARMFUL

TITLE = "Odd splats"


class FindingsDialog:
    """A box to tick for each kind of oddity; removing is one step that can be undone."""

    names: tuple[str, ...] = ("findings",)

    def __init__(self) -> None:
        self._chosen: dict[str, bool] = {}

    def ask(self, ui: Ui, name: str) -> None:
        """Open it with the harmful kinds ticked."""
        self._chosen = {finding.kind: finding.kind in HARMFUL for finding in ui.session.findings}
        imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """One frame."""
        em = imgui.get_font_size()
        center_next_window(ImVec2(38 * em, 0))
        if not imgui.begin_popup_modal(TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        findings = ui.session.findings
        imgui.text_wrapped("Some splats of this scene may show up as haze or spikes, or trouble other programs.")
        imgui.spacing()
        for finding in findings:
            _, self._chosen[finding.kind] = imgui.checkbox(f"##{finding.kind}", self._chosen.get(finding.kind, False))
            ui.mark(f"findings.{finding.kind}")
            imgui.same_line()
            imgui.push_text_wrap_pos(0)
            imgui.text(finding.what)
            imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + imgui.get_frame_height() + scale_pixels(8))
            draw_dim_text(finding.remedy)
            imgui.pop_text_wrap_pos()
        rows = [finding.rows for finding in findings if self._chosen.get(finding.kind)]
        if draw_confirm_buttons(ui, "Remove", False, any(map(len, rows)), cancel="Keep all"):
            ui.session.apply(DeleteRows, np.unique(np.concatenate(rows)))
        imgui.end_popup()
