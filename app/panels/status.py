"""The line at the bottom: what is open, what is selected, how fast it is drawn and on what."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from instdrive_app.panels.ui import Ui, dim_text, fitted_text, icon, scaled
from instdrive_app.theme import ACCENT, rgba
from instdrive_core.scene.selection import Flag


def draw_status(ui: Ui) -> None:
    """Left: the job under way or the open scene. Right: counts, speed, device."""
    session, document = ui.session, ui.session.document
    job = session.jobs.current
    if job is not None:
        imgui.text_colored(rgba(ACCENT), f"{icon('ICON_FA_SPINNER')}  {job.title}…")
    elif document is not None:
        edits = document.history.cursor
        name = session.files.path.name if session.files.path else "scene"
        dim_text(f"{name}   ·   {edits} edit{'' if edits == 1 else 's'}")
    else:
        dim_text("Ready")
    right = "   ·   ".join(_facts(ui))
    width = imgui.calc_text_size(right).x
    imgui.same_line(max(imgui.get_window_width() - width - scaled(14), imgui.get_cursor_pos_x() + scaled(20)))
    dim_text(right)


def _facts(ui: Ui) -> list[str]:
    document = ui.session.document
    facts = []
    if document is not None:
        selected = np.count_nonzero(document.state.mask(Flag.SELECTED))
        deleted = np.count_nonzero(document.state.mask(Flag.DELETED))
        facts += [f"{selected:,} selected", f"{len(document.scene) - deleted:,} splats"]
        if ui.view.frame_seconds:
            facts.append(f"{1 / ui.view.frame_seconds:.0f} fps")
    return [*facts, fitted_text(ui.view.backend, scaled(220))]
