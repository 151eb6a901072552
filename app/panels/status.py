"""The status bar: the open scene, the selection, and how fast and on which device the view is drawn."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec4, imgui

from instdrive_app.memory import MemoryGauge
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, fit_text, get_icon, scale_pixels
from instdrive_app.preferences.themes import ACCENT, DIM
from instdrive_app.session.files.document_files import list_changes
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import format_count


class StatusBar:
    """Shows the running job or the open scene at the left; counts, speed, memory and device at the right."""

    def __init__(self) -> None:
        self._memory = MemoryGauge()

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        left, color = _describe_activity(ui)
        facts, width = self._collect_facts(ui), imgui.get_window_width() - scale_pixels(14)
        gap, between = scale_pixels(24), "   ·   "
        # A narrow window drops the least important facts first.
        while len(facts) > 1 and imgui.calc_text_size(left + between.join(facts)).x + gap > width:
            facts.pop()
        right = between.join(facts)
        place = width - imgui.calc_text_size(right).x
        imgui.text_colored(color, fit_text(left, place - gap))
        imgui.same_line(place)
        draw_dim_text(right)

    def _collect_facts(self, ui: Ui) -> list[str]:
        """Counts, speed, memory and device, the most important first."""
        document, facts = ui.session.document, []
        if document is not None:
            selected = int(np.count_nonzero(document.state.find_mask(Flag.SELECTED)))
            deleted = np.count_nonzero(document.state.find_mask(Flag.DELETED))
            facts += [f"{format_count(selected, 'splat')} selected", f"{len(document.scene) - deleted:,} in total"]
            if ui.view.frame_seconds:
                facts.append(f"{1 / ui.view.frame_seconds:.0f} fps")
        facts.append(f"{self._memory.resident / 2**30:.1f} GiB memory")
        return [*facts, fit_text(ui.view.backend, scale_pixels(220))]


def _describe_activity(ui: Ui) -> tuple[str, ImVec4]:
    session, document = ui.session, ui.session.document
    job = session.jobs.current
    if job is not None:
        return f"{get_icon('ICON_FA_SPINNER')}  {job.title}…", rgba(ACCENT)
    if document is None:
        return "Ready", rgba(DIM)
    name = session.files.path.name if session.files.path else "scene"
    edits = format_count(len(list_changes(document)), "edit")
    return f"{name}   ·   {edits}{', unsaved' if session.files.is_unsaved else ''}", rgba(DIM)
