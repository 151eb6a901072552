"""Asks how the edited drive is to be recorded as sensor data, and where to."""

from __future__ import annotations

import math
import os.path
from dataclasses import replace
from pathlib import Path

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.messages import read_error
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text
from instdrive_app.preferences.themes import ERROR
from instdrive_app.session.making.drive_recorder import (
    LAYOUTS,
    DriveRecorder,
    RecordChoice,
    Way,
    find_folder_problem,
    is_begun,
)
from instdrive_app.session.requests import AskRecord, ShowPanel
from instdrive_core.errors import InstDriveError, OptionError
from instdrive_core.formats.objects.scenario_ways import split_entity
from instdrive_core.recording.depth_files import check_depth_format
from instdrive_core.recording.ego_path import drive_drawn_way, find_ego_way, parse_ego_change, read_ego_way
from instdrive_core.recording.plan import LARGEST, LEAST_WIDTH
from instdrive_core.recording.shutter import LONGEST
from instdrive_core.recording.videos import check_video_request
from instdrive_core.scene.ways.drawn_way import FASTEST
from instdrive_core.sweeps.sensor import NONE, SENSORS
from instdrive_core.wording import count_phrase, format_count, phrase

TITLE = "Record drive"
WAYS: tuple[tuple[Way, str, str, float], ...] = (
    ("own", "The drive's own", "", 0.0),
    ("shift", "Beside its own", "metres to the left", 2.0),
    ("lane", "Change of lane", "metres to the left", 3.5),
    ("speed", "Slower", "times as fast", 0.5),
    ("stop", "Stop", "seconds after the start", 1.0),
    ("drawn", "Drawn on the map", "m/s (0: as recorded)", 0.0),
    ("file", "From a file", "", 0.0),
)
"""Ways of the car: name, title, what the number means, and the number proposed."""
VIDEOS = (("", "No videos"), ("mp4", "Videos as MP4"), ("webm", "Videos as WebM"))
"""Endings of the videos that are written, too, and what the user reads for them."""
LIDARS = {"": "The clip's own", NONE: "None", **{name: name for name in SENSORS}}
"""Sensors whose sweeps are recorded, and what the user reads for them."""
_ROW = 4
_UNREAD = (("", 0, 0), "")
"""State of the file of a way before one was read."""


class RecordDialog:
    """Folder at the top, what is recorded below."""

    def __init__(self) -> None:
        self._folder, self._choice = "", RecordChoice()
        self._read = _UNREAD
        """State of the file of a way that was read last, and why it cannot be driven."""

    def open(self, ui: Ui, request: AskRecord) -> None:
        """Open it with the last choice."""
        self._folder, self._choice = str(ui.session.recorder.propose_folder()), ui.session.recorder.choice
        self._read = _UNREAD
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(ImVec2(40 * imgui.get_font_size(), 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        views = ui.session.document.scene.views if ui.session.document is not None else ()
        imgui.text(translate("Folder"))
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
        entered, self._folder = imgui.input_text("##folder", self._folder, flags)
        ui.mark("record.folder")
        draw_dim_text(
            translate("{views}: colour, masks, depth, 2D and 3D boxes", views=format_count(len(views), "view"))
        )
        imgui.spacing()
        self._draw_width(ui, views[0].camera.width if views else 0)
        self._draw_way(ui)
        self._draw_cameras(ui)
        rolls = self._choice.shutter > 0
        imgui.begin_disabled(rolls)
        flow = imgui.checkbox(make_label("Optical flow"), self._choice.flow and not rolls)[1]
        imgui.end_disabled()
        ui.mark("record.flow")
        if rolls and imgui.is_item_hovered(imgui.HoveredFlags_.allow_when_disabled):
            imgui.set_tooltip(translate("Optical flow is not known through a rolling shutter"))
        imgui.same_line()
        confidence = imgui.checkbox(
            make_label("Confidence maps"), self._choice.confidence or self._choice.way != "own"
        )[1]
        ui.mark("record.confidence")
        if self._choice.way == "own":  # another way has them anyhow
            self._choice = replace(self._choice, confidence=confidence)
        imgui.same_line()
        exr = imgui.checkbox(make_label("Depth as OpenEXR"), self._choice.exr)[1]
        ui.mark("record.exr")
        imgui.set_item_tooltip(translate("Metres as .exr, which Nuke and Blender read, instead of NumPy's .npz"))
        self._choice = replace(self._choice, flow=flow, exr=exr)
        self._draw_lidar(ui)
        self._draw_video(ui)
        self._draw_layouts(ui)
        problem = self._find_problem(ui.session.recorder)
        if not problem and self._choice.way == "drawn":
            problem = _find_drawing_problem(ui, self._choice.amount)
        elif not problem and self._choice.way == "file":
            problem = self._find_file_problem(ui)
        imgui.push_text_wrap_pos(0)
        if problem:
            imgui.text_colored(rgba(ERROR), translate(problem))
            ui.mark("record.problem")
        elif is_begun(self._folder):
            draw_dim_text(
                translate("Goes on with the recording in this folder, if the drive and these settings are the same.")
            )
            ui.mark("record.begun")
        else:
            draw_dim_text(translate("You can cancel at any moment, and go on later with the same folder and settings."))
        imgui.pop_text_wrap_pos()
        if draw_confirm_buttons(ui, "Record", entered, not problem):
            ui.session.recorder.begin(Path(os.path.expanduser(self._folder.strip())).absolute(), self._choice)
        imgui.end_popup()

    def _draw_width(self, ui: Ui, trained: int) -> None:
        imgui.set_next_item_width(7 * imgui.get_font_size())
        changed, width = imgui.input_int(make_label("pixels wide"), self._choice.width or trained, 0)
        ui.mark("record.width")
        if changed:
            self._choice = replace(self._choice, width=None if width == trained else width)

    def _draw_way(self, ui: Ui) -> None:
        """The car's way, and its number."""
        way = next(entry for entry in WAYS if entry[0] == self._choice.way)
        imgui.set_next_item_width(13 * imgui.get_font_size())
        if imgui.begin_combo(make_label("way of the car"), translate(way[1])):
            for name, title, _, amount in WAYS:
                if imgui.selectable(make_label(title), name == way[0])[0]:
                    self._choice = replace(self._choice, way=name, amount=amount)
                ui.mark(f"record.way.{name}")
            imgui.end_combo()
        ui.mark("record.way")
        if way[2]:
            imgui.same_line()
            imgui.set_next_item_width(5 * imgui.get_font_size())
            amount = imgui.input_float(make_label(way[2], "amount"), self._choice.amount, 0.0, 0.0, "%g")[1]
            ui.mark("record.amount")
            if math.isfinite(amount):
                self._choice = replace(self._choice, amount=amount)

        if way[0] == "drawn":
            self._draw_drawing(ui)
        elif way[0] == "file":
            imgui.set_next_item_width(-1)
            hint = translate("keys as .json, or .xosc of OpenSCENARIO, with #ENTITY or without")
            file = imgui.input_text_with_hint("##way_file", hint, self._choice.way_file)[1]
            ui.mark("record.way_file")
            self._choice = replace(self._choice, way_file=file)

    def _draw_drawing(self, ui: Ui) -> None:
        """Say what is drawn, and lead to the map."""
        drawn = ui.session.ego_way
        if imgui.button(make_label("Draw it on the map")):
            drawn.is_drawing, ui.session.recorder.choice = True, self._choice
            ui.session.requests.put(ShowPanel("Map"))
            imgui.close_current_popup()
        ui.mark("record.draw")
        imgui.same_line()
        imgui.align_text_to_frame_padding()
        draw_dim_text(translate(count_phrase(len(drawn.places), "{count} place is drawn", "{count} places are drawn")))

    def _draw_cameras(self, ui: Ui) -> None:
        """Which cameras record, and through what shutter."""
        imgui.set_next_item_width(13 * imgui.get_font_size())
        rig = imgui.input_text_with_hint(
            make_label("file of other cameras"), translate("the drive's own cameras"), self._choice.rig
        )[1]
        ui.mark("record.rig")
        imgui.set_item_tooltip(translate("A JSON file that adds, moves or replaces cameras; see docs/recording.md"))
        imgui.set_next_item_width(7 * imgui.get_font_size())
        shutter = imgui.input_float(make_label("seconds of rolling shutter"), self._choice.shutter, 0.0, 0.0, "%g")[1]
        ui.mark("record.shutter")
        imgui.set_item_tooltip(
            translate("Time between a picture's first and last line, such as 0.03; 0 takes the picture at once")
        )
        self._choice = replace(self._choice, rig=rig, shutter=shutter if math.isfinite(shutter) else 0.0)

    def _draw_lidar(self, ui: Ui) -> None:
        """Whose sweeps are recorded."""
        lidar = self._choice.lidar
        imgui.set_next_item_width(13 * imgui.get_font_size())
        if imgui.begin_combo(make_label("LiDAR"), translate(LIDARS.get(lidar, lidar))):
            for name, title in LIDARS.items():
                if imgui.selectable(make_label(title), name == lidar)[0]:
                    lidar = name
                ui.mark(f"record.lidar.{name or 'own'}")
            imgui.end_combo()
        ui.mark("record.lidar")
        imgui.same_line()
        imgui.begin_disabled(lidar == NONE)
        drop = imgui.checkbox(make_label("Rays get lost"), self._choice.ray_drop and lidar != NONE)[1]
        imgui.end_disabled()
        ui.mark("record.ray_drop")
        if imgui.is_item_hovered(imgui.HoveredFlags_.allow_when_disabled):
            imgui.set_tooltip(translate("Surfaces lose rays as often as in the clip's own sweeps"))
        self._choice = replace(self._choice, lidar=lidar, ray_drop=drop)

    def _draw_video(self, ui: Ui) -> None:
        title = next(title for kind, title in VIDEOS if kind == self._choice.video)
        imgui.set_next_item_width(13 * imgui.get_font_size())
        if imgui.begin_combo(make_label("of each camera and of all"), translate(title)):
            for kind, name in VIDEOS:
                if imgui.selectable(make_label(name), kind == self._choice.video)[0]:
                    self._choice = replace(self._choice, video=kind)
                ui.mark(f"record.video.{kind or 'none'}")
            imgui.end_combo()
        ui.mark("record.video")

    def _draw_layouts(self, ui: Ui) -> None:
        imgui.spacing()
        imgui.text(translate("Also in the layout of"))
        chosen = set(self._choice.layouts)
        for place, (name, title) in enumerate(LAYOUTS.items()):
            if place % _ROW:
                imgui.same_line(place % _ROW * 9.5 * imgui.get_font_size())
            ticked = imgui.checkbox(title, name in chosen)[1]
            ui.mark(f"record.layout.{name}")
            chosen = chosen | {name} if ticked else chosen - {name}
        self._choice = replace(self._choice, layouts=tuple(name for name in LAYOUTS if name in chosen))

    def _find_file_problem(self, ui: Ui) -> str:
        """Say why the way of the file cannot be driven; the file is read once for each of its states."""
        name, document = os.path.expanduser(self._choice.way_file.strip()), ui.session.document
        if not name or document is None:
            return "Name a file that holds the way of the car"
        file = split_entity(name)[0]
        try:
            stamp = os.stat(file)
        except OSError:
            return "There is no such file of a way"
        key = (name, stamp.st_mtime_ns, stamp.st_size)
        if self._read[0] != key:
            try:
                drawn = read_ego_way(name).place_in_scene(document.scene.origin)
                drive_drawn_way(find_ego_way(document.scene.views), drawn)
                self._read = key, ""
            except InstDriveError as error:
                self._read = key, read_error(error)
        return self._read[1]

    def _find_problem(self, recorder: DriveRecorder) -> str:
        width, arguments = self._choice.width, self._choice.list_arguments()
        if recorder.is_running:
            return "Another recording is still running"
        if width is not None and not LEAST_WIDTH <= width <= LARGEST:
            return phrase("Pictures are from {least} to {largest} pixels wide", least=LEAST_WIDTH, largest=LARGEST)
        if not 0 <= self._choice.shutter <= LONGEST:
            return phrase("A rolling shutter takes from 0 to {longest:g} seconds", longest=LONGEST)
        rig = os.path.expanduser(self._choice.rig.strip())
        if rig and not os.path.isfile(rig):
            return "There is no such file of cameras"
        try:
            check_video_request([self._choice.video] if self._choice.video else [])
            check_depth_format("exr" if self._choice.exr else "npz")
        except InstDriveError as error:
            return read_error(error)
        if "--ego" in arguments and self._choice.way != "file":
            try:
                parse_ego_change(arguments[arguments.index("--ego") + 1])
            except OptionError as error:
                return read_error(error)
        return find_folder_problem(self._folder)


def _find_drawing_problem(ui: Ui, speed: float) -> str:
    """Say why the drawn way cannot be driven, for the user; empty where it can."""
    way, document = ui.session.ego_way, ui.session.document
    if not way.is_way or document is None:
        return "Draw the way on the map first: two places at least"
    if not 0 <= speed <= FASTEST:
        return phrase("The car drives at from 0 to {fastest:g} m/s; 0 is as fast as recorded", fastest=FASTEST)
    try:
        drive_drawn_way(find_ego_way(document.scene.views), way.build(speed or None))
    except OptionError as error:
        return read_error(error)
    return ""
