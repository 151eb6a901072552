"""Cameras of other programs beside a scene's file: they give a foreign scene its photos, its first view and its up."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from instdrive_core.datasets.colmap.clips import list_colmap_photos
from instdrive_core.datasets.inria_cameras import CAMERAS, read_inria_cameras
from instdrive_core.datasets.nerfstudio import LISTING, list_nerfstudio_photos
from instdrive_core.datasets.posed_photos import STEP_SECONDS, PosedPhoto, get_camera_name, straighten_photo
from instdrive_core.errors import DataError
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene

_log = logging.getLogger(__name__)
PHOTO_FOLDERS = ("images", "input", ".")
"""Folders beside the cameras in which photos are looked for."""
_SUFFIXES = ("", ".png", ".jpg", ".jpeg", ".JPG", ".PNG")
LEAST_SEEN = 0.02
"""Share of the splats that half of the cameras must see: others belong to another scene, or to another frame of it."""
_LOOKED_AT, _MOST_ASKED = 3000, 25


@dataclass(frozen=True)
class CamerasBeside:
    """What was found beside a scene's file."""

    file: Path
    """What the cameras were read from."""
    views: tuple[CameraView, ...]
    """Empty where the cameras cannot be used."""
    note: str
    """What the user should know."""


def attach_cameras_beside(scene: Scene, path: Path) -> CamerasBeside | None:
    """Give a scene of another program, opened from `path`, the cameras that lie beside it, where it has none.

    Returns what was found; None where nothing is. A damaged file is told of and leaves the scene as it is.
    """
    if scene.views or scene.start is not None or len(scene.table) or not len(scene) or not path.is_file():
        return None
    found = find_cameras_file(path)
    if found is None:
        return None
    file, read = found
    try:
        photos = read()
    except DataError as error:
        _log.warning("cameras beside %s: %s", path, error)
        return CamerasBeside(file, (), f"Cameras beside the scene were left out: {error}")
    views = _build_views(photos)
    if not _fit(scene, views):
        return CamerasBeside(file, (), f"The cameras of {file.name} do not look at this scene and were left out")
    scene.views = views
    there = sum(bool(view.photo) for view in views)
    which = f"{there} of them with photos" if there else "their photos are not there"
    return CamerasBeside(file, views, f"{len(views)} cameras from {file.name}, {which}")


def find_cameras_file(path: Path) -> tuple[Path, Callable[[], list[PosedPhoto]]] | None:
    """Find the file of cameras that belongs to a scene's file, and what reads it; None where there is none.

    It lies in the same folder or, as the INRIA trainer writes scenes, above ``point_cloud/iteration_N``.
    """
    folders = [path.parent]
    if path.parent.name.startswith("iteration_") and path.parent.parent.name == "point_cloud":
        folders.append(path.parent.parent.parent)
    for folder in folders:
        if (folder / CAMERAS).is_file():
            photos = folder / "images" if (folder / "images").is_dir() else folder
            return folder / CAMERAS, partial(read_inria_cameras, folder / CAMERAS, photos)
        if (folder / LISTING).is_file():
            return folder / LISTING, partial(list_nerfstudio_photos, folder)
        if (folder / "sparse").is_dir():
            return folder / "sparse", partial(list_colmap_photos, folder)
    return None


def _build_views(photos: list[PosedPhoto]) -> tuple[CameraView, ...]:
    """Number each camera's photos in the order of their names, a step apart."""
    counts: dict[str, int] = {}
    views = []
    for photo in sorted(photos, key=lambda photo: photo.name):
        name = get_camera_name(photo)
        index = counts[name] = counts.get(name, -1) + 1
        file = find_photo(photo.file)
        views.append(
            CameraView(straighten_photo(photo).camera, name, index, index * STEP_SECONDS, str(file) if file else "")
        )
    return tuple(views)


def find_photo(file: Path) -> Path | None:
    """Find a photo by its listed name, with an ending where none is listed, also in the folders usual for photos."""
    for folder in (file.parent, *(file.parent / name for name in PHOTO_FOLDERS)):
        for suffix in _SUFFIXES:
            place = folder / f"{file.name}{suffix}"
            if place.is_file():
                return place
    return None


def _fit(scene: Scene, views: tuple[CameraView, ...]) -> bool:
    """Whether at least half of the cameras see some of the scene."""
    means = scene.gaussians.means[:: 1 + len(scene) // _LOOKED_AT]
    shares = []
    for view in views[:: 1 + len(views) // _MOST_ASKED]:
        pixels, depths = view.camera.project(means)
        inside = (pixels >= 0).all(axis=1) & (pixels <= (view.camera.width, view.camera.height)).all(axis=1)
        shares.append(float(np.mean(inside & (depths > 0))))
    return float(np.median(shares)) >= LEAST_SEEN
