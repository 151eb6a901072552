"""The status bar: the open scene, the selection, and how fast and on which device the view is drawn."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec4, imgui

from instdrive_app.language.translation import translate
from instdrive_app.memory import MemoryGauge
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, fit_text, get_icon, name_work, scale_pixels
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
            facts += [
                translate("{splats} selected", splats=format_count(selected, "splat")),
                translate("{count:,} in total", count=len(document.scene) - deleted),
            ]
            if ui.view.frame_seconds:
                facts.append(translate("{rate:.0f} fps", rate=1 / ui.view.frame_seconds))
        facts.append(translate("{size:.1f} GiB memory", size=self._memory.resident / 2**30))
        return [*facts, fit_text(ui.view.backend, scale_pixels(220))]


def _describe_activity(ui: Ui) -> tuple[str, ImVec4]:
    session, document = ui.session, ui.session.document
    job = session.jobs.current
    if job is not None:
        share = "" if job.share is None or job.stop.is_set() else f"  {job.share:.0%}"
        return f"{get_icon('ICON_FA_SPINNER')}  {name_work(job)}{share}", rgba(ACCENT)
    if document is None:
        return translate("Ready"), rgba(DIM)
    name = session.files.path.name if session.files.path else translate("scene")
    edits = format_count(len(list_changes(document)), "edit")
    said = translate("{edits}, unsaved", edits=edits) if session.files.is_unsaved else translate(edits)
    return f"{name}   ·   {said}", rgba(DIM)
