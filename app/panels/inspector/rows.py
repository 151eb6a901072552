"""Rows of the inspector: a dim label with a fact or a widget beside it."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.ui import draw_dim_text, fit_text

LABEL_WIDTH = 5.2
"""Width of the label column, in font sizes."""


def draw_widget_label(name: str) -> None:
    """Draw the label of the widget that comes next."""
    imgui.align_text_to_frame_padding()
    draw_fact_label(name)


def draw_fact_label(name: str) -> None:
    """Draw the label of the text that comes next."""
    draw_dim_text(translate(name))
    imgui.same_line(imgui.get_font_size() * LABEL_WIDTH)


def draw_fact(name: str, value: str) -> None:
    """Draw a label and a value, both translated where they are texts; a value that is too long is cut."""
    draw_fact_label(name)
    imgui.text(fit_text(translate(value), imgui.get_content_region_avail().x))
