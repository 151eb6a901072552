"""What can be exported of an edited scene, and how it is written. A new kind is an entry of `KINDS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import numpy as np

from instdrive_app.state import EditorState, ViewMode, Viewpoint
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.queries.scene_parts import find_remaining_actors, find_selected_actors, find_selected_rows
from instdrive_core.errors import OptionError
from instdrive_core.filming.camera_path import CameraKey, CameraPath
from instdrive_core.filming.film import FilmSettings, check_film, write_film
from instdrive_core.filming.path_file import write_camera_path
from instdrive_core.filming.video import CODECS
from instdrive_core.formats.objects.writers import SUFFIXES, write_objects
from instdrive_core.formats.registry import FORMATS, find_format_to_write
from instdrive_core.masks.export.coco_panoptic import write_coco_panoptic
from instdrive_core.masks.export.id_maps import MAX_SIDE, choose_views, render_id_maps
from instdrive_core.masks.export.id_pictures import save_png, write_id_pictures
from instdrive_core.progress import report, report_span
from instdrive_core.project.export import ExportedParts, export_actors, export_instances, export_scene
from instdrive_core.project.nurec import describe_hand_over, export_hand_over
from instdrive_core.rasterize.pictures import Look, draw_picture
from instdrive_core.recording.ego_path import find_ego_way
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import Phrase, format_count, phrase

What = Literal["scene", "selection", "instances", "actors", "objects", "masks", "cameras", "view", "film", "nurec"]
WRITTEN = tuple(fmt.suffix for fmt in FORMATS if fmt.suffix.startswith(".") and fmt.write is not None)
"""Endings of scene files; names that folders are known by are none."""
WITH_TRACKS = tuple(fmt.suffix for fmt in FORMATS if fmt.keeps_tracks)
"""Endings of those that keep the tracks of moving objects; that of a folder is empty."""
_BAKING = 0.2
RENDERED_MODES: dict[ViewMode, Look] = {
    ViewMode.COLOR: "color",
    ViewMode.INSTANCE: "instance",
    ViewMode.CODEWORD: "codeword",
    ViewMode.DEPTH: "depth",
    ViewMode.CENTERS: "centers",
    ViewMode.RINGS: "rings",
}
"""What the core draws for each view mode."""


@dataclass(frozen=True)
class ExportChoice:
    """Everything the user chose besides the path."""

    what: What = "scene"
    suffix: str = ".ply"
    """Ending of the files in a folder of instances or actors."""
    sibr: bool = False
    """Whether a .ply is written in the layout of SIBR viewers."""
    keep_tracks: bool = True
    """Whether actors keep their tracks in a scene folder; else they stand where they are at the shown time."""
    hulls: bool = False
    """Whether convex hulls are written instead of boxes."""
    coco: bool = False
    """Whether masks are written in COCO's panoptic format instead of plain pictures."""
    scale: float = 1.0
    """Size of pictures relative to the cameras' films."""
    film: FilmSettings = field(default_factory=FilmSettings)
    """Size, rate and look of a film."""
    nurec_tracks: str = ""
    """NuRec's sequence_tracks.json or .usdz; empty where IDs and times are the scene's own."""


@dataclass(frozen=True)
class ExportRequest:
    """Everything that writing needs; made on the UI's thread, written on another."""

    document: Document
    """Must not be edited while it is written."""
    path: Path
    choice: ExportChoice
    time: float
    viewpoint: Viewpoint
    view_mode: ViewMode
    show_sky: bool
    path_keys: tuple[CameraKey, ...] = ()

    @classmethod
    def capture(cls, document: Document, path: Path, choice: ExportChoice, state: EditorState) -> ExportRequest:
        """Capture the time and view shown now."""
        return cls(
            document, path, choice, state.time, state.viewpoint, state.view_mode, state.draws_sky, state.path_keys
        )


@dataclass(frozen=True)
class ExportKind:
    """One thing that can be exported."""

    title: str
    write: Callable[[ExportRequest], str]
    """Writes it, and returns what was written, for the user."""
    endings: tuple[str, ...] = ()
    """Endings of the file; empty for a folder of files."""
    scene_folder: bool = False
    """Whether the path can also be that of a scene folder."""
    suggestion: str = ""
    """End of the proposed name, after the scene's own."""
    amount: Callable[[Document], str] = lambda _: ""
    """Says how much there is to export; empty for nothing."""
    missing: str = ""
    """What the user reads where there is nothing to export."""
    filled_folder: bool = False
    """Whether the path can also be that of a new folder, which is filled with files."""

    @property
    def takes_folder(self) -> bool:
        """Whether the path can be a folder's."""
        return self.scene_folder or self.filled_folder or not self.endings


def choose_instances(document: Document) -> tuple[int, ...]:
    """Choose the selected instances, or all that are left."""
    counts = document.count_states()
    return document.find_selected_instances() or tuple(counts.ids[counts.count > counts.deleted].tolist())


def choose_actors(document: Document) -> tuple[int, ...]:
    """Choose the nodes of the actors with anything selected, or of all that are left."""
    return find_selected_actors(document) or find_remaining_actors(document)


def _write_scene(request: ExportRequest) -> str:
    return _write_scene_or_part(request, None)


def _write_selection(request: ExportRequest) -> str:
    return _write_scene_or_part(request, find_selected_rows(request.document))


def _write_scene_or_part(request: ExportRequest, rows: np.ndarray | None) -> str:
    path, choice = request.path, request.choice
    sibr = choice.sibr and path.name.lower().endswith(".ply")
    keeps_tracks = choice.keep_tracks and find_format_to_write(path, sibr)[0].keeps_tracks
    time = None if keeps_tracks else request.time
    count = export_scene(request.document, path, time, rows, sibr=sibr, start=_make_start(request))
    return phrase("Exported {splats} to {path}, read back and compared", splats=format_count(count, "splat"), path=path)


def _make_start(request: ExportRequest) -> Camera:
    """Make the camera with which an exported .ply opens: the present view."""
    return request.viewpoint.make_film_camera()


def _write_instances(request: ExportRequest) -> str:
    choice, ids = request.choice, choose_instances(request.document)
    sibr = choice.sibr and choice.suffix == ".ply"
    written = export_instances(request.document, request.path, ids, request.time, choice.suffix, sibr=sibr)
    skipped = (
        phrase(
            "{instances} not present at {time:g} s",
            instances=format_count(written.skipped, "instance"),
            time=request.time,
        )
        if written.skipped
        else ""
    )
    told = _describe_parts(written, format_count(len(written.files), "instance"), request.path)
    return phrase("{told}; {skipped}", told=told, skipped=skipped) if skipped else told


def _write_actors(request: ExportRequest) -> str:
    choice, nodes = request.choice, choose_actors(request.document)
    sibr = choice.sibr and choice.suffix == ".ply"
    written = export_actors(request.document, request.path, nodes, choice.suffix, sibr=sibr)
    return phrase(
        "{parts}; their poses are in .poses.json",
        parts=_describe_parts(written, format_count(len(written.files), "actor"), request.path),
    )


def _write_objects(request: ExportRequest) -> str:
    with report_span(0.0, _BAKING):
        scene = bake_document(request.document, to_read=True)
    hulls, ways = request.choice.hulls, request.path.suffix.lower() == ".xosc"
    ego = find_ego_way(scene.views) if ways and scene.views else None
    written = write_objects(request.path, scene, request.time, "hull" if hulls else "box", ego)
    instances, path = format_count(len(written), "instance"), request.path
    if ways:
        return phrase("Exported the ways of {instances} to {path}", instances=instances, path=path)
    if hulls:
        return phrase("Exported the hulls of {instances} to {path}", instances=instances, path=path)
    return phrase("Exported the boxes of {instances} to {path}", instances=instances, path=path)


def _write_masks(request: ExportRequest) -> str:
    with report_span(0.0, _BAKING):
        scene = bake_document(request.document, to_read=True)
    views = choose_views(scene)
    write = write_coco_panoptic if request.choice.coco else write_id_pictures
    with report_span(_BAKING, 1.0):
        maps = render_id_maps(scene, views, request.choice.scale)
        count = write(request.path, scene, maps, lambda done: report(done / len(views)))
    return phrase("Exported the masks of {photos} to {path}", photos=format_count(count, "photo"), path=request.path)


def _write_cameras(request: ExportRequest) -> str:
    scene = _bake_shown_scene(request)
    views = choose_views(scene)
    with report_span(_BAKING, 1.0):
        for number, view in enumerate(views):
            report(number / len(views))
            path = request.path / view.name / f"{view.index:02d}.png"
            _save_picture(path, scene, view.camera, view.time, request)
    return phrase("Exported {pictures} to {path}", pictures=format_count(len(views), "picture"), path=request.path)


def _write_view(request: ExportRequest) -> str:
    scene, camera = _bake_shown_scene(request), request.viewpoint.make_film_camera()
    with report_span(_BAKING, 1.0):
        _save_picture(request.path, scene, camera, request.time, request)
    return phrase("Exported the picture to {path}", path=request.path)


def _write_film(request: ExportRequest) -> str:
    if not request.path_keys:
        raise OptionError(KINDS["film"].missing)
    if request.path.suffix.lower() == ".json":
        write_camera_path(request.path, request.path_keys)
        return phrase(
            "Exported the {keys} of the camera path to {path}",
            keys=format_count(len(request.path_keys), "key"),
            path=request.path,
        )
    path, film = CameraPath(request.path_keys), request.choice.film
    check_film(path.end - path.start, film, request.path)
    scene = _bake_shown_scene(request)
    with report_span(_BAKING, 1.0):
        count = write_film(request.path, scene, path, film)
    return phrase("Exported a film of {frames} to {path}", frames=format_count(count, "frame"), path=request.path)


def _write_nurec(request: ExportRequest) -> str:
    tracks = request.choice.nurec_tracks.strip()
    plan = export_hand_over(request.document, request.path, Path(tracks).expanduser() if tracks else None)
    return phrase("Handed over to {path}: {hand_over}", path=request.path, hand_over=describe_hand_over(plan))


def _bake_shown_scene(request: ExportRequest) -> Scene:
    """Bake what is drawn: nothing hidden, tracks kept."""
    document = request.document
    with report_span(0.0, _BAKING):
        scene = bake_document(document, None, np.flatnonzero(document.state.drawn))
    return scene if request.show_sky else replace(scene, sky=None)


def _save_picture(path: Path, scene: Scene, camera: Camera, time: float, request: ExportRequest) -> None:
    camera = camera.scale(request.choice.scale)
    if max(camera.width, camera.height) > MAX_SIDE:
        raise OptionError(
            phrase(
                "a picture of {width} × {height} pixels is too large; choose a smaller size",
                width=camera.width,
                height=camera.height,
            )
        )
    save_png(path, draw_picture(scene, camera, time, RENDERED_MODES[request.view_mode]))


def _describe_parts(written: ExportedParts, files: Phrase, folder: Path) -> str:
    splats = format_count(written.splats, "splat")
    return phrase(
        "Exported {files} of {splats} to {folder}, read back and compared", files=files, splats=splats, folder=folder
    )


def _count_splats(document: Document) -> str:
    left = len(document.state) - len(document.state.find_rows(Flag.DELETED))
    return format_count(left, "splat") if left else ""


def _count_selected_splats(document: Document) -> str:
    count, instances = len(document.state.find_rows(Flag.SELECTED)), len(document.find_selected_instances())
    found = phrase(
        "{splats} of {instances}", splats=format_count(count, "splat"), instances=format_count(instances, "instance")
    )
    return found if count else ""


def _count_chosen_instances(document: Document) -> str:
    count = len(choose_instances(document))
    selected = bool(document.find_selected_instances())
    found = format_count(count, "selected instance") if selected else format_count(count, "instance")
    return found if count else ""


def _count_instances(document: Document) -> str:
    counts = document.count_states()
    left = int((counts.count > counts.deleted).sum())
    return format_count(left, "instance") if left else ""


def _count_actors(document: Document) -> str:
    count = len(choose_actors(document))
    selected = bool(find_selected_actors(document))
    found = format_count(count, "selected actor") if selected else format_count(count, "actor")
    return found if count else ""


def _count_photos(document: Document) -> str:
    views = document.scene.views
    return format_count(len(views), "photo") if views else ""


def _count_edits_of_a_drive(document: Document) -> str:
    count = sum(not edit.selects_only for edit in document.history.done)
    return format_count(count, "edit") if count and document.first_tracks else ""


_NO_INSTANCES, _NO_CAMERAS = "The scene has no instances", "The scene has no photo cameras"

KINDS: dict[What, ExportKind] = {
    "scene": ExportKind("Whole scene", _write_scene, WRITTEN, True, "_edited.ply", _count_splats, "No splats are left"),
    "selection": ExportKind(
        "Selection only",
        _write_selection,
        WRITTEN,
        True,
        "_selection.ply",
        _count_selected_splats,
        "Nothing is selected",
    ),
    "instances": ExportKind(
        "One file per instance",
        _write_instances,
        suggestion="_instances",
        amount=_count_chosen_instances,
        missing=_NO_INSTANCES,
    ),
    "actors": ExportKind(
        "Actors in their own frames",
        _write_actors,
        suggestion="_actors",
        amount=_count_actors,
        missing="The scene has no moving actors",
    ),
    "objects": ExportKind(
        "Boxes of instances",
        _write_objects,
        SUFFIXES,
        suggestion="_objects.json",
        amount=_count_instances,
        missing=_NO_INSTANCES,
    ),
    "masks": ExportKind(
        "Masks of the photos", _write_masks, suggestion="_masks", amount=_count_photos, missing=_NO_CAMERAS
    ),
    "cameras": ExportKind(
        "Pictures from the photos' cameras",
        _write_cameras,
        suggestion="_pictures",
        amount=_count_photos,
        missing=_NO_CAMERAS,
    ),
    "view": ExportKind("Picture of this view", _write_view, (".png",), suggestion="_view.png", amount=_count_splats),
    "film": ExportKind(
        "Film along the camera path",
        _write_film,
        (*CODECS, ".json"),
        filled_folder=True,
        suggestion="_film.mp4" if find_spec("av") else "_film",
        amount=_count_splats,
        missing="The camera path has no keys; add views to it with Shift+K",
    ),
    "nurec": ExportKind(
        "Edits for NVIDIA NuRec",
        _write_nurec,
        suggestion="_nurec",
        amount=_count_edits_of_a_drive,
        missing="There are no edits, or nothing moves: NuRec edits moving objects only",
    ),
}
"""Kinds in the order of the dialog."""
