"""Facts about the selected instances; the class can be changed in place."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.inspector.rows import draw_fact, draw_fact_label, draw_widget_label
from instdrive_app.panels.widgets.codeword import draw_bit_squares
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, scale_pixels
from instdrive_app.session.selection_box import SelectionBoxes
from instdrive_app.session.versioned_cache import VersionedCache
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.presence import find_time_there, list_passing
from instdrive_core.instances.table import Instance
from instdrive_core.wording import phrase

Ids = tuple[int, ...]


class FactsSection:
    """Shows all facts of one instance, or totals of several."""

    title: str = ""

    def __init__(self) -> None:
        self._class = TextField("class")
        self._known: VersionedCache[tuple[set[str], int, int]] = VersionedCache()
        self._boxes = SelectionBoxes()
        self._size: VersionedCache[Float64[ndarray, "3"]] = VersionedCache()

    def draw(self, ui: Ui, document: Document, ids: Ids) -> None:
        """Draw one frame."""
        table, labels = document.scene.table, ui.session.labels
        classes, drawn, selected = self._sum_up(document, ids)
        draw_widget_label("Class")
        arrow = imgui.get_frame_height()
        hint = translate("unknown") if len(classes) == 1 else translate("several")
        entered = self._class.draw(ui, "inspector.class", next(iter(classes)) if len(classes) == 1 else "", hint, arrow)
        if entered is not None:
            labels.set_class(ids, entered)
        imgui.same_line(0, 0)
        if imgui.arrow_button("##classes", imgui.Dir.down):
            imgui.open_popup("##known classes")
        ui.mark("inspector.classes")
        self._draw_class_popup(ui, document, ids)
        if len(ids) == 1:
            self._draw_single_instance(ui, document, table[ids[0]])
        else:
            draw_fact("Splats", phrase("{drawn:,}", drawn=drawn))
        if selected < drawn:
            draw_fact("Selected", phrase("{selected:,} of the splats", selected=selected))
            draw_dim_text(translate("Changes below affect whole instances"))

    def _sum_up(self, document: Document, ids: Ids) -> tuple[set[str], int, int]:
        """Classes, and numbers of splats drawn and selected; kept until something changes."""

        def sum_states() -> tuple[set[str], int, int]:
            counts = document.count_states()
            chosen = np.isin(counts.ids, ids)
            drawn, selected = int(counts.drawn[chosen].sum()), int(counts.selected[chosen].sum())
            return {document.scene.table[i].class_name for i in ids}, drawn, selected

        return self._known.get(document, (ids, document.versions.states, document.versions.table), sum_states)

    def _draw_class_popup(self, ui: Ui, document: Document, ids: Ids) -> None:
        if not imgui.begin_popup("##known classes"):
            return
        names = ui.session.labels.list_classes()
        for name in (*names, ""):
            chosen = all(document.scene.table[i].class_name == name for i in ids)
            if imgui.selectable(f"{name}###class {name}" if name else make_label("unknown", "class "), chosen)[0]:
                ui.session.labels.set_class(ids, name)
            ui.mark(f"inspector.class.{name or 'unknown'}")
        imgui.end_popup()

    def _draw_single_instance(self, ui: Ui, document: Document, instance: Instance) -> None:
        summary = document.summarize_instance(instance.id)
        drawn = (
            phrase("{drawn:,}", drawn=summary.drawn)
            if summary.drawn == summary.count
            else phrase("{drawn:,} of {count:,}", drawn=summary.drawn, count=summary.count)
        )
        draw_fact("Splats", drawn)
        if summary.count:
            width, length, height = self._find_size(document, instance.id, ui.session.state.time)
            draw_fact("Size", f"{length:.2f} × {width:.2f} × {height:.2f} m")
            if imgui.is_item_hovered():
                imgui.set_tooltip(translate("Length × width × height"))
        if instance.node:
            track = document.scene.actors[instance.node - 1]
            draw_fact("Moves", phrase("{length:.1f} m along its track", length=track.compute_path_length()))
            self._draw_times(ui, document, instance)
        if document.scene.code_bits:
            draw_fact("Codeword", str(instance.codeword))
            imgui.same_line(0, scale_pixels(10))
            imgui.set_cursor_pos_y(imgui.get_cursor_pos_y() + (imgui.get_text_line_height() - scale_pixels(9)) / 2)
            draw_bit_squares(instance.codeword, document.scene.code_bits, scale_pixels(9), scale_pixels(2))

    def _draw_times(self, ui: Ui, document: Document, instance: Instance) -> None:
        """Say when a moving object is there, where that is not all the time; a button goes there from other times."""
        navigation, time = ui.session.navigation, ui.session.state.time
        for track in list_passing(document, (instance.id,), navigation.timeline.steps):
            draw_fact_label("Seen")
            imgui.text(phrase("{start:.2f} to {end:.2f} s", start=track.times[0], end=track.times[-1]))
            there = find_time_there(document, (instance.id,), navigation.timeline.steps, time)
            if there != time:
                imgui.same_line()
                if imgui.small_button(f"{phrase('Go to {time:.2f} s', time=there)}###go to time"):
                    navigation.bring_into_view((instance.id,))
                ui.mark("inspector.go_to_time")

    def _find_size(self, document: Document, instance_id: int, time: float) -> Float64[ndarray, "3"]:
        """Width, length and height of the box that the gizmo holds, kept until something changes."""
        versions = document.versions
        key = (instance_id, versions.geometry, versions.table, versions.states)
        return self._size.get(document, key, lambda: self._boxes.find_box(document, (instance_id,), time).size)


class TextField:
    """A text field: Enter or leaving it applies the text, Escape restores it."""

    def __init__(self, name: str) -> None:
        self._id = name
        self._text: str | None = None

    def draw(self, ui: Ui, mark: str, present: str, hint: str = "", free: float = 0.0) -> str | None:
        """Draw one frame, `free` pixels short of the right edge; returns the text if it was changed, else None."""
        imgui.set_next_item_width(imgui.get_content_region_avail().x - free)
        shown = present if self._text is None else self._text
        entered, text = imgui.input_text_with_hint(
            f"##{self._id}",
            hint,
            shown,
            imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all,
        )
        ui.mark(mark)
        if imgui.is_item_active():
            self._text = text
            return None
        was, self._text = self._text, None
        if was is None and not entered:
            return None
        cancelled = imgui.is_key_pressed(imgui.Key.escape)
        text = text.strip()
        return text if text != present and not cancelled else None
