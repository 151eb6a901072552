"""Asks what objects are found by: the scene alone, or photos and their masks; and begins."""

from __future__ import annotations

import os.path
from pathlib import Path

from imgui_bundle import ImVec2, imgui

from instdrive_app.files.file_names import find_working_folder, is_displayable
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.dialogs.making.source_field import SourceField
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text
from instdrive_app.preferences.themes import ERROR
from instdrive_app.session.making.job_controller import SourceLook
from instdrive_app.session.making.object_finder import FindChoice
from instdrive_app.session.requests import AskFindObjects
from instdrive_core.wording import phrase

TITLE = "Find objects"
_BEST, _FOLDER = "", "folder"
MASKS = {
    _BEST: phrase("the best there are"),
    "exact": phrase("made now from the synthetic clip's labels"),
    "annotations": phrase("made now from boxes, classes and LiDAR"),
    "lidar": phrase("made now from LiDAR and photos"),
    "sam": phrase("made now by Segment Anything"),
    _FOLDER: phrase("a folder with a label map for each photo"),
}
"""Where masks come from, by the name that the job takes."""


class FindObjectsDialog:
    """The two ways at the top; photos, masks and what becomes of instances below the second."""

    def __init__(self) -> None:
        self._source = SourceField("find", build_command=lambda ui, path: ui.session.finder.build_look_command(path))
        self._by_photos = False
        self._masks, self._mask_folder = _BEST, ""
        self._replaces = False
        self._free, self._known = 0, 0
        """Splats without an instance, and instances."""

    def open(self, ui: Ui, request: AskFindObjects) -> None:
        """Open it; photos that the scene tells of are filled in."""
        finder, document = ui.session.finder, ui.session.document
        known = finder.known_photos
        self._by_photos = known is not None and not finder.obstacle
        self._source.reset(ui, f"{find_working_folder()}{os.path.sep}" if known is None else str(known))
        self._masks, self._mask_folder = _BEST, ""
        self._known = 0 if document is None else len(document.scene.table)
        self._free = finder.count_free_splats()
        self._replaces = not self._free
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(ImVec2(44 * imgui.get_font_size(), 0), always=True)
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        self._draw_ways(ui)
        entered, problem, is_ready = False, "", True
        if self._by_photos:
            imgui.separator()
            entered = self._source.draw(ui, "Folder with the photos of this scene and their poses", 5, focus=False)
            look = self._source.find_look(ui)
            self._source.draw_look(ui, look, "Choose the data set that the scene was trained with.", 7)
            self._draw_masks(ui, look)
            self._draw_instances(ui)
            problem = self._find_problem(ui, look)
            is_ready = look is not None and look.is_ready and not look.problem
        if problem:
            imgui.push_text_wrap_pos(0)
            imgui.text_colored(rgba(ERROR), translate(problem))
            imgui.pop_text_wrap_pos()
            ui.mark("find.obstacle")
        if draw_confirm_buttons(ui, "Find objects", entered, is_ready and not problem):
            self._begin(ui)
        imgui.end_popup()

    def _draw_ways(self, ui: Ui) -> None:
        if imgui.radio_button(make_label("From the scene alone"), not self._by_photos):
            self._by_photos = False
        ui.mark("find.alone")
        draw_dim_text(translate("What stands on the ground and hangs together becomes an object. It takes seconds."))
        if imgui.radio_button(make_label("From photos and their masks"), self._by_photos):
            self._by_photos = True
        ui.mark("find.photos")
        draw_dim_text(translate("What is one thing in the photos becomes an object, though it may touch others."))

    def _draw_masks(self, ui: Ui, look: SourceLook | None) -> None:
        """Where the masks come from: the best by itself, others that the photos allow, or a folder."""
        plans: tuple[str, ...] = () if look is None else look.mask_plans
        offered = [_BEST, *(plan for plan in plans[1:] if plan in MASKS), _FOLDER]
        if self._masks not in offered:
            self._masks = _BEST
        imgui.align_text_to_frame_padding()
        imgui.text(translate("Masks"))
        imgui.same_line(9 * imgui.get_font_size())
        imgui.set_next_item_width(-1)
        if imgui.begin_combo("##masks", translate(MASKS[self._masks])):
            for name in offered:
                if imgui.selectable(make_label(MASKS[name]), name == self._masks)[0]:
                    self._masks = name
                ui.mark(f"find.masks.{name or 'best'}")
            imgui.end_combo()
        ui.mark("find.masks")
        if self._masks == _FOLDER:
            imgui.set_next_item_width(-1)
            _, self._mask_folder = imgui.input_text_with_hint(
                "##folder", translate("path of the folder"), self._mask_folder
            )
            ui.mark("find.folder")

    def _draw_instances(self, ui: Ui) -> None:
        """What becomes of instances that are there, where there are some."""
        if not self._known:
            return
        imgui.begin_disabled(not self._free)
        changed, replaces = imgui.checkbox(
            make_label("Replace the {count:,} instances that are there", count=self._known), self._replaces
        )
        imgui.end_disabled()
        ui.mark("find.replace")
        if changed:
            self._replaces = replaces
        draw_dim_text(
            translate("Every visible splat gets the instance that the masks show; names are lost.")
            if self._replaces
            else translate("Instances stay; splats that belong to none get one, or join the one they are part of.")
        )

    def _find_problem(self, ui: Ui, look: SourceLook | None) -> str:
        if ui.session.finder.obstacle:
            return ui.session.finder.obstacle
        if self._masks == _FOLDER:
            folder = Path(os.path.expanduser(self._mask_folder))
            if not self._mask_folder.strip() or not is_displayable(folder) or not os.path.isdir(folder):
                return "Enter the folder of the masks"
            return ""
        if look is not None and look.is_ready and not look.problem and not look.mask_plans:
            return (
                "There are no masks, and nothing to make them of. Choose a folder with a label map for each photo, "
                "or install Segment Anything: pip install 'instdrive[sam]'"
            )
        return ""

    def _begin(self, ui: Ui) -> None:
        if not self._by_photos:
            ui.session.labels.find_objects()
            return
        masks = os.path.abspath(os.path.expanduser(self._mask_folder)) if self._masks == _FOLDER else self._masks
        ui.session.finder.begin(FindChoice(self._source.path, masks, self._replaces and bool(self._known)))
