"""What dialogs that begin a job share: how long it may take, and the folder that it writes."""

from __future__ import annotations

import os.path
from collections.abc import Sequence
from pathlib import Path

from imgui_bundle import imgui

from instdrive_app.files.file_names import find_documents_folder
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, fit_text
from instdrive_core.wording import phrase

LEAST_MINUTES, MOST_MINUTES = 0.1, 10_000.0


def draw_minutes(ui: Ui, mark: str, qualities: Sequence[tuple[str, float]], minutes: float) -> float:
    """Draw proposals and a field for the minutes; returns what is chosen. `mark` begins the names of the widgets."""
    for name, proposed in qualities:
        label = make_label("{quality}, {minutes:.0f} min", f"quality {name}", quality=phrase(name), minutes=proposed)
        if imgui.radio_button(label, minutes == proposed):
            minutes = proposed
        ui.mark(f"{mark}.quality.{name}")
        imgui.same_line()
    imgui.set_next_item_width(6 * imgui.get_font_size())
    changed, typed = imgui.input_float(make_label("minutes"), minutes, 0.0, 0.0, "%g")
    ui.mark(f"{mark}.minutes")
    if changed and LEAST_MINUTES <= typed <= MOST_MINUTES:
        minutes = typed
    draw_dim_text(
        fit_text(
            translate("Some steps are timed on this machine first; then the minutes decide how long it trains."),
            imgui.get_content_region_avail().x,
        )
    )
    return minutes


def propose_run_folder(name: str) -> Path:
    """Propose a folder of this name among the user's documents, with a number where there is one already."""
    folder = find_documents_folder()
    tries = (folder / (name if number == 1 else f"{name} {number}") for number in range(1, 1000))
    return next((path for path in tries if not os.path.lexists(path)), folder / name)
