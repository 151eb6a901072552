"""Photos whose poses are known from the ``cameras.json`` beside a scene alone, as a clip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.inria_cameras import CAMERAS, read_inria_cameras
from instdrive_core.datasets.posed_photos import ListedPoints, build_photo_clip
from instdrive_core.project.cameras_beside import find_cameras_file, find_photo


def find_inria_cameras(scene: Path) -> Path | None:
    """Find the ``cameras.json`` that belongs to a scene's file; None where there is none."""
    found = find_cameras_file(scene) if scene.is_file() else None
    return found[0] if found is not None and found[0].name == CAMERAS else None


def open_clip_of_cameras(cameras: Path, photos: Path, options: ClipOptions) -> Clip:
    """Open the photos of a folder with the poses of a ``cameras.json``, in whose names endings may be missing.

    Raises DataError where the file is damaged or no photo of it is in the folder, OptionError for options that do not
    fit.
    """
    listed = read_inria_cameras(cameras, photos)
    there = [replace(photo, file=find_photo(photo.file) or photo.file) for photo in listed]
    return build_photo_clip(photos, cameras, there, ListedPoints.none(), options)
