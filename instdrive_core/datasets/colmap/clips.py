"""Folders of COLMAP: a model in ``sparse/0``, ``sparse`` or the folder itself, photos below ``images``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.colmap import binary as colmap_binary
from instdrive_core.datasets.colmap import text as colmap_text
from instdrive_core.datasets.colmap.model import REMEDY, ColmapModel
from instdrive_core.datasets.posed_photos import ListedPoints, PosedPhoto, build_photo_clip, resolve_inner_path
from instdrive_core.errors import DataError

_MODEL_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", ".")
PHOTOS = "images"


def holds_colmap(path: str | Path) -> bool:
    """Whether the folder holds a model of COLMAP."""
    return _find_model_folder(Path(path)) is not None


def load_colmap(path: str | Path, options: ClipOptions) -> Clip:
    """Open a folder with a COLMAP model: a static clip that starts from the model's points.

    Raises DataError where the model is damaged or no photo is there, OptionError for options that do not fit.
    """
    root = Path(path)
    model = _read_folder(root)
    return build_photo_clip(root, model.listing, _place_photos(root, model), model.points, options)


def list_colmap_photos(root: Path) -> list[PosedPhoto]:
    """List the photos of a folder with a COLMAP model, in the model's own world. Raises as `load_colmap`."""
    return _place_photos(root, _read_folder(root))


def _read_folder(root: Path) -> ColmapModel:
    folder = _find_model_folder(root)
    if folder is None:
        raise DataError(root, "holds no COLMAP model (sparse/0/cameras.bin or .txt)", "Give the folder above 'sparse'")
    return read_colmap_model(folder)


def _place_photos(root: Path, model: ColmapModel) -> list[PosedPhoto]:
    """Give each photo of a model its file, camera and pose."""
    photos_folder = root / PHOTOS if (root / PHOTOS).is_dir() else root
    photos = []
    for image in model.images:
        if image.camera_id not in model.cameras:
            problem = f"image {image.name!r} was taken by camera {image.camera_id}, which the model does not hold"
            raise DataError(model.listing, problem, REMEDY)
        camera, distortion = model.cameras[image.camera_id]
        posed = replace(camera, world_from_camera=image.world_from_camera)
        photos.append(
            PosedPhoto(image.name, resolve_inner_path(model.listing, photos_folder, image.name), posed, distortion)
        )
    return photos


def read_colmap_model(folder: Path) -> ColmapModel:
    """Read a model, binary where it is there in both forms. A model without points is one.

    Raises DataError where anything about it is wrong.
    """
    is_binary = (folder / "cameras.bin").is_file()
    form, suffix = (colmap_binary, "bin") if is_binary else (colmap_text, "txt")
    listing, points = folder / f"images.{suffix}", folder / f"points3D.{suffix}"
    return ColmapModel(
        form.read_cameras(folder / f"cameras.{suffix}"),
        form.read_images(listing),
        form.read_points(points) if points.is_file() else ListedPoints.none(),
        listing,
    )


def _find_model_folder(root: Path) -> Path | None:
    for name in _MODEL_FOLDERS:
        if any((root / name / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt")):
            return root / name
    return None
