"""Asks how far apart the parts of an instance must be to become instances of their own."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.ui import Ui, draw_bounded_slider, draw_dim_text, scale_size
from instdrive_app.session.requests import AskSplit
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.split import DEFAULT_GAP, SplitInstance
from instdrive_core.wording import phrase

TITLE = "Split by component"
MOST_SIZES = 6
"""Parts whose sizes are listed one by one."""


class SplitDialog:
    """Previews the parts that a gap gives; they are computed on another thread."""

    def __init__(self) -> None:
        self._instance, self._gap = 0, DEFAULT_GAP
        self._split = SplitInstance(1)
        self._sizes: tuple[int, ...] | None = None
        """Splats in each part that `_split` makes; None while they are computed."""

    def open(self, ui: Ui, request: AskSplit) -> None:
        """Open it for an instance of the document."""
        document = ui.session.document
        if document is None or request.instance not in document.scene.table:
            return
        self._instance = request.instance
        self._preview(ui)
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(scale_size(360, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        document = ui.session.document
        if document is None or self._instance not in document.scene.table:
            imgui.close_current_popup()  # what was under way beside the dialog has made it part of another
            imgui.end_popup()
            return
        imgui.text_wrapped(document.scene.table[self._instance].name)
        imgui.align_text_to_frame_padding()
        draw_dim_text(translate("Parts farther apart than"))
        imgui.same_line()
        imgui.set_next_item_width(-1)
        _, self._gap = draw_bounded_slider("##gap", self._gap, 0.05, 5.0, "%.2f m", imgui.SliderFlags_.logarithmic)
        ui.mark("split.gap")
        if imgui.is_item_deactivated_after_edit():
            self._preview(ui)
        imgui.push_text_wrap_pos(0)
        imgui.text(translate(_describe_parts(self._sizes)))
        imgui.pop_text_wrap_pos()
        if draw_confirm_buttons(ui, "Split", False, self._sizes is not None and len(self._sizes) > 1):
            ui.session.labels.split(self._split)
        imgui.end_popup()

    def _preview(self, ui: Ui) -> None:
        document = ui.session.document
        assert document is not None
        split = self._split = SplitInstance(self._instance, self._gap)
        self._sizes = None

        def show(sizes: tuple[int, ...]) -> None:
            if split is self._split:
                self._sizes = sizes

        frozen = freeze_document(document)
        ui.session.jobs.submit("Looking for parts", lambda: split.prepare(frozen), show, modal=False)


def _describe_parts(sizes: tuple[int, ...] | None) -> str:
    if sizes is None:
        return "Looking for parts…"
    if len(sizes) < 2:
        return "The instance is all one part; try a smaller gap."
    shown = " · ".join(translate("{size:,}", size=size) for size in sizes[:MOST_SIZES])
    if len(sizes) > MOST_SIZES:
        shown = f"{shown} …"
    return phrase("{count} parts of {sizes} splats", count=len(sizes), sizes=shown)
