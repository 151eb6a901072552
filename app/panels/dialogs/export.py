"""The export dialog's rows above the path: what to export, in which format, and the format's options."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.messages import user_message
from instdrive_app.panels.dialogs.file_purposes import PURPOSES, FilePurpose
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, scale_pixels
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.export_kinds import KINDS, WITH_TRACKS, WRITTEN, ExportChoice, What
from instdrive_core.errors import InstDriveError
from instdrive_core.filming.film import FILM_MODES, LARGEST, FilmSettings, check_film
from instdrive_core.filming.video import CODECS
from instdrive_core.formats.registry import FORMATS
from instdrive_core.rasterize.pictures import Mode
from instdrive_core.wording import chain_sentences, format_count, phrase

"""What is exported at first, by the purpose that the dialog is opened for."""
_TITLES = {fmt.suffix: fmt.title for fmt in FORMATS}
_OBJECT_FILES = ((".json", "Boxes, and tracks of moving objects"), (".glb", "3D scene with one node per instance"))
_MASK_FORMATS = ((False, "PNG: exact colours and labels"), (True, "COCO panoptic"))
_FILM_FILES = (
    (".mp4", ".mp4   H.264"),
    (".webm", ".webm   VP9"),
    ("", "PNG frames"),
    (".json", ".json   Keys only"),
)
_SCALES = (1.0, 2.0, 4.0)
_ENDINGS_WITH_IDS = (".ply", ".glb", ".gltf", *WITH_TRACKS)
_LABEL_EM, _COMBO_EM = 4.2, 27.0
_LABELS = ("Export", "As")
Key = TypeVar("Key")


class ExportOptions:
    """Draws the rows; the choices themselves are kept in `session.export`."""

    rows = 3
    """Lines that the options take above the path."""

    def begin(self, session: EditorSession, what: What) -> str:
        """The dialog opens under one of `names`; returns the path to propose."""
        session.export.begin(what)
        return str(session.export.propose_path())

    def build_purpose(self, session: EditorSession) -> FilePurpose:
        """The purpose that accepts the paths that fit the present choice."""
        kind = session.export.kind
        refusal = "" if session.export.amounts.get(session.export.choice.what) else kind.missing
        purpose = replace(PURPOSES["export"], suffixes=kind.endings, refusal=refusal)
        return replace(purpose, folders=kind.takes_folder, fills=kind.filled_folder)

    def draw(self, ui: Ui, path: str) -> str:
        """Draw one frame; returns the path, renamed where the choice needs another ending."""
        exporting = ui.session.export
        _draw_label("Export")
        kinds: list[tuple[What, str]] = [(name, kind.title) for name, kind in KINDS.items()]
        what = _draw_combo(ui, "what", kinds, exporting.choice.what)
        if what != exporting.choice.what:
            exporting.choice = replace(exporting.choice, what=what)
            path = str(exporting.propose_path_in(path))
        imgui.same_line()
        draw_dim_text(translate(exporting.amounts.get(exporting.choice.what, "")))
        _draw_label("As")
        path = self._draw_format(ui, path)
        _draw_label("")
        draw_dim_text(translate(_describe_choice(ui.session, path)))
        return path

    def _draw_format(self, ui: Ui, path: str) -> str:
        exporting = ui.session.export
        choice = exporting.choice
        match choice.what:
            case "scene" | "selection":
                ending = _draw_combo(
                    ui, "format", [(suffix, _format_title(suffix)) for suffix in (*WRITTEN, "")], find_ending(path)
                )
                path = replace_ending(path, ending)
                exporting.choice = _draw_scene_switches(ui, choice, ending)
            case "instances" | "actors":
                suffix = _draw_combo(
                    ui, "format", [(suffix, _format_title(suffix)) for suffix in WRITTEN], choice.suffix
                )
                exporting.choice = _draw_scene_switches(ui, replace(choice, suffix=suffix), suffix)
            case "objects":
                titles = [(suffix, f"{suffix}   {translate(title)}") for suffix, title in _OBJECT_FILES]
                path = replace_ending(path, _draw_combo(ui, "format", titles, find_ending(path)))
                exporting.choice = replace(choice, hulls=_draw_switch(ui, "hulls", "Hulls", choice.hulls))
            case "masks":
                coco = _draw_combo(ui, "format", _MASK_FORMATS, choice.coco)
                exporting.choice = replace(choice, coco=coco, scale=_draw_scale(ui, choice))
            case "film":
                path = _draw_film_rows(ui, path)
            case "nurec":
                imgui.set_next_item_width(_COMBO_EM * imgui.get_font_size())
                hint = "NuRec's sequence_tracks.json or .usdz (optional)"
                tracks = imgui.input_text_with_hint("##tracks", translate(hint), choice.nurec_tracks)[1]
                ui.mark("export.nurec.tracks")
                if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
                    imgui.set_tooltip(translate("Whose actors and times are meant; without it, the scene's own"))
                exporting.choice = replace(choice, nurec_tracks=tracks)
            case "cameras" | "view":
                imgui.align_text_to_frame_padding()
                mode = phrase(ui.session.state.view_mode.value)
                imgui.text(translate(".png   {mode}, as in the view", mode=mode))
                exporting.choice = replace(choice, scale=_draw_scale(ui, choice))
        return path


def find_ending(path: str) -> str:
    """Find the longest known file ending of a path; empty if it has none."""
    known = (*WRITTEN, *(suffix for suffix, _ in _OBJECT_FILES), *CODECS, ".png")
    name = path.rpartition("/")[2].lower()
    return max((suffix for suffix in known if name.endswith(suffix)), key=len, default="")


def replace_ending(path: str, ending: str) -> str:
    """Replace a path's known ending by another; a path that already has the ending stays exactly as it is."""
    own = find_ending(path)
    return path if own == ending else f"{path[: len(path) - len(own)]}{ending}"


def _draw_scene_switches(ui: Ui, choice: ExportChoice, ending: str) -> ExportChoice:
    document = ui.session.document
    if ending == ".ply":
        hint = "SH degree 3 and exactly the columns that SIBR expects; any name that ends in .ply will do"
        return replace(choice, sibr=_draw_switch(ui, "sibr", "For SIBR viewers", choice.sibr, hint))
    if ending in WITH_TRACKS and document is not None and document.scene.actors:
        hint = "Without tracks, moving objects stay where they are at the time shown"
        return replace(choice, keep_tracks=_draw_switch(ui, "tracks", "Keep tracks", choice.keep_tracks, hint))
    return choice


def _describe_choice(session: EditorSession, path: str) -> str:
    """Explain what the present choice means for time and instances."""
    choice, document, ending = session.export.choice, session.document, find_ending(path)
    has_actors = document is not None and bool(document.scene.actors)
    standing = (
        phrase("Moving objects stay where they are at {time:.2f} s.", time=session.state.time) if has_actors else ""
    )
    match choice.what:
        case "scene" | "selection":
            tracked = ending in WITH_TRACKS and choice.keep_tracks
            moment = "Moving objects keep their tracks." if tracked and has_actors else standing
            has_ids = document is not None and len(document.scene.table) > 0
            keeps_ids = ending in _ENDINGS_WITH_IDS and not (choice.sibr and ending == ".ply")
            return chain_sentences(moment, "" if keeps_ids or not has_ids else "This format cannot hold instance IDs.")
        case "instances":
            return chain_sentences(standing, "instances.json lists the files.")
        case "actors":
            return "x right, y forward, z up from the box's centre; poses go into .poses.json."
        case "objects":
            return (
                chain_sentences(standing, "A .json holds all times.")
                if has_actors
                else "Upright boxes around the solid splats."
            )
        case "masks":
            return "What a click would select, seen by each photo's camera."
        case "cameras":
            return "One folder per camera; hidden splats are left out."
        case "film":
            return _describe_film(session, path)
        case "nurec":
            return "edit-assets.json and external_assets. What was done to the street is listed."
        case "view":
            lens, scale = session.state.viewpoint.lens, choice.scale
            return phrase(
                "{width:.0f} × {height:.0f} pixels; hidden splats are left out.",
                width=lens.width * scale,
                height=lens.height * scale,
            )


def _describe_film(session: EditorSession, path: str) -> str:
    """Say what the film will be, or why it cannot be made."""
    keys, film = session.state.path_keys, session.export.choice.film
    if find_ending(path) == ".json":
        return "The path's keys, for instdrive render --path."
    try:
        count = check_film(keys[-1].at - keys[0].at if keys else 0.0, film, Path(path))
    except InstDriveError as error:
        return user_message(error)
    note = "Hidden splats are left out."
    if find_ending(path) and film.mode == "instance":
        note = "IDs can be read back from PNG only."
    return phrase(
        "{frames} of {width} × {height} pixels, {rate:g} per second. {note}",
        frames=format_count(count, "frame"),
        width=film.width,
        height=film.height,
        rate=film.rate,
        note=phrase(note),
    )


def _draw_film_rows(ui: Ui, path: str) -> str:
    """Draw what a film shows, its size and rate; returns the path, with the ending of the chosen kind of file."""
    exporting = ui.session.export
    film, height = exporting.choice.film, imgui.get_font_size()
    path = replace_ending(path, _draw_combo(ui, "format", _FILM_FILES, find_ending(path), 9.0))
    imgui.same_line()
    chosen = _draw_combo(ui, "film.mode", tuple(FILM_MODES.items()), film.mode, 7.0)
    modes: dict[str, Mode] = {name: name for name in FILM_MODES}
    imgui.same_line()
    imgui.set_next_item_width(8.0 * height)
    size = imgui.input_int2("##size", [film.width, film.height])[1]
    ui.mark("export.film.size")
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        imgui.set_tooltip(translate("Width and height in pixels"))
    imgui.same_line()
    imgui.set_next_item_width(4.0 * height)
    rate = imgui.input_float("##rate", film.rate, format="%.4g")[1]
    ui.mark("export.film.rate")
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        imgui.set_tooltip(translate("Frames per second"))
    rate = rate if math.isfinite(rate) else film.rate
    settings = FilmSettings(_keep_size(size[0]), _keep_size(size[1]), rate, modes[chosen])
    exporting.choice = replace(exporting.choice, film=settings)
    return path


def _keep_size(side: int) -> int:
    """Keep a typed number of pixels in a range in which it can be shown; what is still wrong is said on export."""
    return min(max(side, 1), 10 * LARGEST)


def _format_title(suffix: str) -> str:
    return f"{suffix}   {translate(_TITLES[suffix])}".lstrip()


def _draw_label(text: str) -> None:
    imgui.align_text_to_frame_padding()
    draw_dim_text(translate(text))
    widest = max(imgui.calc_text_size(translate(word)).x for word in _LABELS) + scale_pixels(10)
    imgui.same_line(max(_LABEL_EM * imgui.get_font_size(), widest))


def _draw_combo(ui: Ui, name: str, entries: Sequence[tuple[Key, str]], current: Key, width: float = _COMBO_EM) -> Key:
    """Draw a drop-down list and return the chosen key; marks: ``export.NAME`` and ``export.NAME.KEY``."""
    imgui.set_next_item_width(width * imgui.get_font_size())
    opened = imgui.begin_combo(f"##{name}", translate(dict(entries).get(current, "")), imgui.ComboFlags_.height_large)
    ui.mark(f"export.{name}")
    if not opened:
        return current
    chosen = current
    for key, title in entries:
        if imgui.selectable(f"{translate(title)}###choice {key}", key == current)[0]:
            chosen = key
        ui.mark(f"export.{name}.{key}")
    imgui.end_combo()
    return chosen


def _draw_switch(ui: Ui, name: str, title: str, on: bool, hint: str = "") -> bool:
    imgui.same_line()
    on = imgui.checkbox(make_label(title), on)[1]
    ui.mark(f"export.{name}")
    if hint and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        imgui.set_tooltip(translate(hint))
    return on


def _draw_scale(ui: Ui, choice: ExportChoice) -> float:
    """Draw the choice of picture size and return it, as a factor of the film's size."""
    scale = choice.scale
    for factor in _SCALES:
        imgui.same_line()
        if imgui.radio_button(f"{factor:g}×", scale == factor):
            scale = factor
        ui.mark(f"export.scale.{factor:g}")
    return scale
