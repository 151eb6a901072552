"""Records a drive into a folder, view by view; what is there already is kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.file_lock import FileLock
from instdrive_core.progress import report, report_span
from instdrive_core.recording.boxes import describe_box, place_boxes
from instdrive_core.recording.confidence import PHOTOS, count_seeing_photos
from instdrive_core.recording.drive import Drive
from instdrive_core.recording.folder import (
    FORMAT,
    LOCK,
    MANIFEST,
    PLAN,
    VERSION,
    check_folder,
    list_missing,
    name_file,
    name_moment,
    write_listing,
    write_view,
)
from instdrive_core.recording.plan import compute_fingerprint, describe_view
from instdrive_core.recording.report import summarize_recording, write_recording_report
from instdrive_core.recording.sweep_files import CastSweep, name_sweep, write_moment_sweep
from instdrive_core.recording.things import Thing, find_boxed_things, is_stuff, label_groups
from instdrive_core.recording.views import ViewRecorder, number_classes
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene

CONVENTIONS = {
    "length": "metres, or the clip's own unit where its scale is unknown",
    "world": "right-handed, z up; add 'origin' for the data set's world",
    "camera": "OpenCV: x right, y down, z forward; pixel centres lie at +0.5",
    "box": "rotation is world from box, a quaternion w, x, y, z; in the box x is right, y forward, z up",
    "heading_known": "false: y is the longer side, one way or the other",
    "from": "track: the actor's; annotation: the clip's; splats: fitted to what is drawn",
    "box_visible, box_amodal": "x, y, width, height in pixels; amodal as if nothing stood in front, cut at the picture",
    "visibility": "visible pixels as a share of those of the whole silhouette inside the picture",
    "flow": "pixels right and down to where the surface is in the camera's next picture, hidden there or not",
    "confidence": "share of the weight from splats that at least 2 training photos saw; 255 is all of it",
    "depth": "along the viewing axis; .png in millimetres (0 = nothing, 65535 = that or more), .npz or .exr in metres",
    "shutter": "where it is named, seconds from the first to the last line; time and pose are those of the middle one",
    "time": "seconds since the clip's first time step",
}
"""Conventions that every manifest states."""


_COUNTING = 0.2
"""Share of the time that looking through all photos takes, where confidence is recorded."""


def record_drive(folder: Path, drive: Drive) -> dict[str, Any]:
    """Record all views and moments of a drive, and return the manifest, which is written last.

    A folder in which the same drive was begun is finished: views that are whole are kept. Stopping at any moment
    leaves whole files only.

    Args:
        folder: new, or one in which the same drive was begun.
        drive: what is recorded.

    Raises DataError where the folder cannot be written, holds something else, or another program records into it.
    """
    scene, views, cast_sweep = drive.scene, drive.views, drive.cast_sweep
    plan = {
        "format": FORMAT,
        "version": VERSION,
        "scene": compute_fingerprint(scene),
        "exposed": drive.exposed,
        "flow": drive.flow,
        "confidence": drive.photographed is not None,
        "lidar": None if cast_sweep is None else drive.sensor,
        "views": [describe_view(view) for view in views],
        **_describe_shutter(drive),
        **({"ray_drop": True} if drive.lidar is not None and drive.lidar.drop is not None else {}),
        **({} if drive.depth_format == "npz" else {"depth": drive.depth_format}),
    }
    begun = check_folder(folder, plan)
    held = _lock_folder(folder)
    try:
        things = find_boxed_things(scene, drive.moves, drive.annotated)
        if not begun:
            write_listing(folder / PLAN, plan)
        missing = list_missing(folder, views)
        if missing:
            _remove_manifest(folder)
        _record_views(folder, drive, missing, things)
        _write_moments(folder, scene, views, things)
        if cast_sweep is not None:
            _record_sweeps(folder, views, cast_sweep)
        manifest = (
            _describe_recording(scene, views, things) | _describe_shutter(drive) | summarize_recording(folder, views)
        )
        write_recording_report(folder, manifest)
        write_listing(folder / MANIFEST, manifest)
        return manifest
    finally:
        with suppress(OSError):  # Windows removes no open file
            (folder / LOCK).unlink()
        held.release()


def _describe_shutter(drive: Drive) -> dict[str, Any]:
    """What plan and manifest say of a rolling shutter; nothing where there is none."""
    return {} if drive.rolling is None else {"shutter": asdict(drive.rolling.shutter)}


def _lock_folder(folder: Path) -> FileLock:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = FileLock.acquire(folder / LOCK)
    except OSError as error:
        problem = f"the folder cannot be written ({error.strerror or error})"
        raise DataError(folder, problem, "Free some space or choose another place") from error
    if held is None:
        raise DataError(folder, "another program is recording into it", "Wait for that, or name another folder")
    return held


def _remove_manifest(folder: Path) -> None:
    try:
        (folder / MANIFEST).unlink(missing_ok=True)
    except OSError as error:
        problem = f"the manifest of an unfinished recording cannot be removed ({error.strerror or error})"
        raise DataError(folder / MANIFEST, problem, "Choose a folder that can be written") from error


def _record_views(folder: Path, drive: Drive, missing: Sequence[CameraView], things: Sequence[Thing]) -> None:
    """Draw view after view; files are packed and written meanwhile."""
    if not missing:
        report(1.0)
        return
    scene, views = drive.scene, drive.views
    with report_span(0.0, _COUNTING if drive.photographed is not None else 0.0):
        trusted = _find_trusted(drive)
    groups, classes = label_groups(things, len(scene)), number_classes(scene)
    recorder = ViewRecorder(scene, things, groups, classes, drive.exposed, trusted, drive.rolling)
    following = _list_following(views) if drive.flow else {}
    with report_span(_COUNTING if drive.photographed is not None else 0.0, 1.0):
        _draw_views(folder, recorder, missing, drive, following)


def _find_trusted(drive: Drive) -> Bool[ndarray, " n"] | None:
    """Splats of the edited scene that enough photos saw; None where no confidence is asked for."""
    known = drive.photographed
    if known is None:
        return None
    counts = count_seeing_photos(known.scene, [view for view in known.scene.views if not view.held_out])
    return counts[known.rows] >= PHOTOS


def _list_following(views: Sequence[CameraView]) -> dict[tuple[str, int], CameraView]:
    """The next view of the same camera, by camera and step."""
    last: dict[str, CameraView] = {}
    found: dict[tuple[str, int], CameraView] = {}
    for view in views:
        if view.name in last:
            found[view.name, last[view.name].index] = view
        last[view.name] = view
    return found


def _draw_views(
    folder: Path,
    recorder: ViewRecorder,
    missing: Sequence[CameraView],
    drive: Drive,
    following: Mapping[tuple[str, int], CameraView],
) -> None:
    scene, count = recorder.scene, len(drive.views)
    packed = int(scene.instance_ids.max(initial=0)) > np.iinfo(np.uint16).max
    before = count - len(missing)
    with ThreadPoolExecutor(max_workers=1) as pool:
        waiting: Future[None] | None = None
        for number, view in enumerate(missing):
            report((before + number) / count)
            recorded = recorder.record(view, following.get((view.name, view.index)))
            if waiting is not None:
                waiting.result()
            waiting = pool.submit(write_view, folder, recorded, packed, drive.depth_format)
        if waiting is not None:
            waiting.result()
    report(1.0)


def _write_moments(folder: Path, scene: Scene, views: Sequence[CameraView], things: Sequence[Thing]) -> None:
    for step, time in _list_moments(views).items():
        boxes = [describe_box(box) for box in place_boxes(scene, things, time)]
        write_listing(folder / name_moment(step), {"step": step, "time": time, "boxes": boxes})


def _record_sweeps(folder: Path, views: Sequence[CameraView], cast_sweep: CastSweep) -> None:
    """Cast the sweeps that are not there yet; a file that is there is whole."""
    for step, time in _list_moments(views).items():
        path = folder / name_sweep(step)
        if not path.is_file():
            write_moment_sweep(path, cast_sweep(step, time))


def _list_moments(views: Sequence[CameraView]) -> dict[int, float]:
    moments: dict[int, float] = {}
    for view in views:
        moments.setdefault(view.index, view.time)
    return moments


def _describe_recording(scene: Scene, views: Sequence[CameraView], things: Sequence[Thing]) -> dict[str, Any]:
    boxed = {thing.instance.id for thing in things}
    classes = number_classes(scene)
    return {
        "format": FORMAT,
        "version": VERSION,
        "conventions": CONVENTIONS,
        "origin": scene.origin.tolist(),
        "cameras": list(dict.fromkeys(view.name for view in views)),
        "classes": [{"number": number, "name": name} for name, number in classes.items()],
        "instances": [
            {
                "id": instance.id,
                "name": instance.name,
                "class": instance.class_name,
                "class_number": classes.get(instance.class_name, 0),
                "is_thing": not is_stuff(instance),
                "has_box": instance.id in boxed,
                "color": list(instance.color),
            }
            for instance in scene.table
        ],
        "moments": [
            {"step": step, "time": time, "file": name_moment(step)} for step, time in _list_moments(views).items()
        ],
        "views": [
            describe_view(view) | {"file": name_file("views", view, ".json"), "color": name_file("color", view, ".png")}
            for view in views
        ],
    }
