"""Poses of photos by pycolmap: features, matches, and a model that is built photo by photo. Each step goes on where an
earlier one was interrupted, as the database beside the photos keeps what was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.errors import DataError

DATABASE = "colmap.db"
LENSES = {"simple": "SIMPLE_RADIAL", "opencv": "OPENCV", "fisheye": "OPENCV_FISHEYE"}
"""COLMAP's camera models by the words of the command line."""
MOST_EXHAUSTIVE = 80
"""Photos of a folder up to which each is compared with each; more are compared with their neighbours by name."""
_OVERLAP = 10
_LEAST_ANGLE, _LEAST_MATCHES = 4.0, 40
"""Degrees between rays to the points of the first two photos, and their number. COLMAP's own, 16 and 100, are for turns
around an object; drives ahead have no such pair."""
_PHOTOS_AT_A_TIME, _PAIRS_AT_A_TIME = 8, 40
"""Between reports. What is done is in the database, which nobody else may open meanwhile."""
OnStage = Callable[[str, int, int], None]
"""Is told the title of a step, how much is done, and how much there is."""


@dataclass(frozen=True)
class FoundPoses:
    """What structure from motion made of the photos."""

    photos: int
    """Photos with a pose."""
    points: int
    error: float
    """Mean distance in pixels between points and where photos show them."""


def find_poses(folder: Path, names: list[str], lens: str, is_video: bool, on_stage: OnStage) -> FoundPoses:
    """Find poses of the photos `names` below ``images`` and write the largest model to ``sparse/0``.

    Raises DataError where no model comes about, ModuleNotFoundError without pycolmap.
    """
    pycolmap = import_module("pycolmap")
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)
    photos, count = folder / "images", len(names)
    one = len({read_photo_size(photos / name) for name in names}) == 1
    for start in range(0, count, _PHOTOS_AT_A_TIME):
        on_stage("finding features", start, count)
        _find_features(folder, names[start : start + _PHOTOS_AT_A_TIME], lens, one)
    on_stage("finding features", count, count)
    pairs = choose_pairs(count, is_video)
    for start in range(0, len(pairs), _PAIRS_AT_A_TIME):
        on_stage("matching photos", start, len(pairs))
        _match(folder, [(names[a], names[b]) for a, b in pairs[start : start + _PAIRS_AT_A_TIME]])
    on_stage("matching photos", len(pairs), len(pairs))
    best = _place_photos(folder, count, on_stage)
    if best is None or best.num_reg_images() < 3:
        problem = "no poses could be found: too few corners of one photo are found again in others"
        remedy = "Take pictures while moving, sharp ones with much overlap, or use more of them (--most)"
        raise DataError(folder, problem, remedy)
    _write_model(best, folder / "sparse" / "0")
    return FoundPoses(best.num_reg_images(), best.num_points3D(), float(best.compute_mean_reprojection_error()))


def choose_pairs(count: int, is_video: bool) -> list[tuple[int, int]]:
    """Choose which photos are compared, by their places: each with each, or with its neighbours where there are many,
    as in a video, and with some farther away, by powers of two."""
    if not is_video and count <= MOST_EXHAUSTIVE:
        return list(combinations(range(count), 2))
    steps = sorted({*range(1, _OVERLAP + 1), *(2**power for power in range(4, 8))})
    return [(place, place + step) for place in range(count) for step in steps if place + step < count]


def _find_features(folder: Path, names: list[str], lens: str, one: bool) -> None:
    """Find features of some photos; those that have some are passed over."""
    pycolmap = import_module("pycolmap")
    database = pycolmap.Database.open(folder / DATABASE)
    cameras = [camera.camera_id for camera in database.read_all_cameras()]
    database.close()
    reader = pycolmap.ImageReaderOptions(camera_model=LENSES[lens])
    if one and cameras:
        reader.existing_camera_id = cameras[0]
    mode = pycolmap.CameraMode.SINGLE if one else pycolmap.CameraMode.PER_IMAGE
    device = pycolmap.Device.cpu
    pycolmap.extract_features(folder / DATABASE, folder / "images", names, mode, reader_options=reader, device=device)


def _match(folder: Path, pairs: list[tuple[str, str]]) -> None:
    """Match some pairs of photos; those that were matched are passed over."""
    pycolmap = import_module("pycolmap")
    with TemporaryDirectory() as name:
        listing = Path(name) / "pairs.txt"
        listing.write_text("".join(f"{first} {second}\n" for first, second in pairs), encoding="utf-8")
        pairing = pycolmap.ImportedPairingOptions(match_list_path=listing)
        pycolmap.match_image_pairs(folder / DATABASE, pairing_options=pairing, device=pycolmap.Device.cpu)


def _place_photos(folder: Path, count: int, on_stage: OnStage) -> Any:
    """The model with the most photos; None where there is none."""
    pycolmap = import_module("pycolmap")
    placed = 0

    def tell_next() -> None:
        nonlocal placed
        placed += 1
        on_stage("placing photos", min(placed + 2, count), count)

    options = pycolmap.IncrementalPipelineOptions(random_seed=0, min_model_size=3)
    options.mapper.init_max_forward_motion = 1.0  # a camera that looks ahead of a car moves in no other way
    options.mapper.init_min_tri_angle = _LEAST_ANGLE
    options.mapper.init_min_num_inliers = _LEAST_MATCHES
    on_stage("placing photos", 0, count)
    with TemporaryDirectory(dir=folder) as work:
        models = pycolmap.incremental_mapping(
            folder / DATABASE, folder / "images", work, options, next_image_callback=tell_next
        )
    return max(models.values(), key=lambda model: model.num_reg_images(), default=None)


def _write_model(model: Any, folder: Path) -> None:
    """Write the model's files; cameras last, as the folder is a clip from then on."""
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder.parent) as name:
        model.write_binary(name)
        for file in sorted(Path(name).iterdir(), key=lambda file: file.name == "cameras.bin"):
            file.replace(folder / file.name)
