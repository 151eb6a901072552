"""Layouts of data sets that a finished recording is written in, each into a folder of its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from instdrive_core.datasets.argoverse.write import write_argoverse
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.clip_recordings import record_clip
from instdrive_core.datasets.drivestudio.write import write_drivestudio
from instdrive_core.datasets.kitti.write import write_kitti_raw, write_kitti_tracking
from instdrive_core.datasets.kitti.write360 import write_kitti360
from instdrive_core.datasets.layout_files import number_steps, write_layout_file
from instdrive_core.datasets.nuscenes.write import write_nuscenes, write_t4
from instdrive_core.datasets.pandaset.write import name_pandaset_cameras, write_pandaset
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.waymo.write import write_waymo
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.new_folder import fill_new_folder
from instdrive_core.masks.export.id_pictures import save_png
from instdrive_core.masks.making import make_masks
from instdrive_core.recording.coco import write_coco
from instdrive_core.recording.folder import name_file, read_id_map, read_manifest
from instdrive_core.recording.mcap_file import write_mcap
from instdrive_core.recording.reading import read_recorded_clip

LAYOUTS = "layouts"
"""Folder of a recording that holds them."""
_DRIVE = "drive"


def _write_pandaset_with_labels(folder: Path, out: Path) -> Path:
    """PandaSet's files and, beside them, the exact labels that this program evaluates with, and masks of them to train
    on."""
    clip = read_recorded_clip(folder)
    recording = record_clip(clip)
    opened = write_pandaset(recording, out)
    manifest, numbers = read_manifest(folder), number_steps(recording)
    names = name_pandaset_cameras(tuple(recording.lenses))
    boxed = {track.id: track.moving for track in clip.tracks}
    if max((entry["id"] for entry in manifest["instances"]), default=0) > np.iinfo(np.uint16).max:
        return opened  # their labels are 16-bit
    for frame in clip.frames:
        view = frame.view
        ids = read_id_map(folder / name_file("instances", view, ".png"))
        with Image.open(folder / name_file("depth", view, ".png")) as picture:
            sky = (np.asarray(picture) == 0) & (ids == 0)
        stem = f"{names[view.name]}/{numbers[view.index]:02d}.png"
        save_png(opened / "labels" / stem, ids.astype(np.uint16))
        save_png(opened / "labels" / "sky" / stem, np.where(sky, 255, 0).astype(np.uint8))
    facts = {
        str(entry["id"]): {
            "class": entry["class"],
            "name": entry["name"],
            "kind": "thing" if entry["is_thing"] else "stuff",
            "moving": boxed.get(str(entry["id"]), False),
            "uuid": str(entry["id"]) if str(entry["id"]) in boxed else None,
        }
        for entry in manifest["instances"]
    }
    write_layout_file(opened / "labels" / "instances.json", json.dumps(facts).encode())
    make_masks(load_clip(str(opened), ClipOptions()), "exact", opened / "masks")
    return opened


def _take(write: Callable[..., Path]) -> Callable[[Path, Path], Path]:
    return lambda folder, out: write(record_clip(read_recorded_clip(folder)), out)


WRITERS: dict[str, Callable[[Path, Path], Path]] = {
    "pandaset": _write_pandaset_with_labels,
    "nuscenes": _take(write_nuscenes),
    "t4": _take(write_t4),
    "kitti-tracking": _take(write_kitti_tracking),
    "kitti-raw": _take(write_kitti_raw),
    "kitti-360": _take(write_kitti360),
    "argoverse": _take(write_argoverse),
    "waymo": _take(write_waymo),
    "drivestudio": _take(write_drivestudio),
    "coco": write_coco,
    "mcap": write_mcap,
}
"""Writers by the name of the layout: from a finished recording into a new folder; each returns what to open."""


def write_recorded_layout(folder: Path, layout: str) -> Path:
    """Write a finished recording in a layout, unless it is there already; returns the folder or file to open.

    It lies below ``layouts/NAME`` of the recording, whole or not at all. Raises DataError where the recording is
    unfinished or the folder cannot be written, MissingExtraError where the layout needs a package that is not there.
    """
    read_manifest(folder)
    place = folder / LAYOUTS / layout
    note = place / "open.json"
    if note.is_file():
        return place / json.loads(note.read_text(encoding="utf-8"))["open"]
    try:
        with fill_new_folder(place) as part:
            opened = WRITERS[layout](folder, part / _DRIVE).relative_to(part)
            (part / note.name).write_text(json.dumps({"open": opened.as_posix()}), encoding="utf-8")
    except ModuleNotFoundError as error:
        raise explain_missing_module(error) or error from error
    return place / opened
