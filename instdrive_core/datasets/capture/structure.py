"""Structure from motion by pycolmap: features, matches, and a model that is built photo by photo. Each step goes on
where an earlier one was interrupted, as the database beside the photos keeps what was found."""

from __future__ import annotations

import os
from importlib import import_module
from itertools import combinations
from pathlib import Path
from typing import Any

from instdrive_core.available_memory import measure_available_memory
from instdrive_core.datasets.capture.poses import FoundPoses, OnStage
from instdrive_core.datasets.photos import read_photo_size

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
_LONGEST_SIDE = 2400
"""Pixels of the longer side at which features are looked for; larger photos are reduced first, poses are not."""
_BYTES_PER_PIXEL = 200.0
"""Memory while features of one photo are looked for: 2.25 GB were measured at 4096×3072 pixels."""


def build_sparse_model(
    folder: Path,
    names: list[str],
    lens: str,
    is_video: bool,
    scratch: Path,
    on_stage: OnStage,
    is_careful: bool = False,
    skipped: tuple[int, ...] = (),
) -> FoundPoses | None:
    """Find poses of the photos `names` below ``images`` and write the largest model to ``model`` in the folder
    `scratch`; None where there is no model of three photos. With `is_careful` each match is kept before the next, and
    pairs at the places `skipped` are not matched.

    Raises ImportError without pycolmap, and what pycolmap raises.
    """
    pycolmap = import_module("pycolmap")
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)
    photos, count = folder / "images", len(names)
    sizes = {read_photo_size(photos / name) for name in names}
    one, threads = len(sizes) == 1, choose_threads(max(sizes, key=max), measure_available_memory(), os.cpu_count() or 1)
    for start in range(0, count, _PHOTOS_AT_A_TIME):
        on_stage("finding features", start, count)
        _find_features(folder, names[start : start + _PHOTOS_AT_A_TIME], lens, one, threads)
    on_stage("finding features", count, count)
    pairs, listing = choose_pairs(count, is_video), scratch / "pairs.txt"
    step = 1 if is_careful else _PAIRS_AT_A_TIME
    for start in range(0, len(pairs), step):
        on_stage("matching photos", start, len(pairs))
        if not is_careful or start not in skipped:
            _match(folder, [(names[a], names[b]) for a, b in pairs[start : start + step]], listing)
    on_stage("matching photos", len(pairs), len(pairs))
    best = _place_photos(folder, count, scratch / "models", on_stage)
    if best is None or best.num_reg_images() < 3:
        return None
    (scratch / "model").mkdir()
    best.write_binary(scratch / "model")
    return FoundPoses(best.num_reg_images(), best.num_points3D(), float(best.compute_mean_reprojection_error()))


def choose_pairs(count: int, is_video: bool) -> list[tuple[int, int]]:
    """Choose which photos are compared, by their places: each with each, or with its neighbours where there are many,
    as in a video, and with some farther away, by powers of two."""
    if not is_video and count <= MOST_EXHAUSTIVE:
        return list(combinations(range(count), 2))
    steps = sorted({*range(1, _OVERLAP + 1), *(2**power for power in range(4, 8))})
    return [(place, place + step) for place in range(count) for step in steps if place + step < count]


def choose_threads(size: tuple[int, int], free: float, cores: int) -> int:
    """Choose how many photos are looked at side by side, by width and height of the largest, free bytes and cores: half
    of the memory is left to others."""
    scale = min(1.0, _LONGEST_SIDE / max(size))
    needed = size[0] * size[1] * scale**2 * _BYTES_PER_PIXEL
    return max(1, min(cores, int(0.5 * free / needed)))


def _find_features(folder: Path, names: list[str], lens: str, one: bool, threads: int) -> None:
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
    options = pycolmap.FeatureExtractionOptions(max_image_size=_LONGEST_SIDE, num_threads=threads)
    pycolmap.extract_features(
        folder / DATABASE, folder / "images", names, mode, reader, extraction_options=options, device=device
    )


def _match(folder: Path, pairs: list[tuple[str, str]], listing: Path) -> None:
    """Match some pairs of photos; those that were matched are passed over. `listing` is a file that may be written."""
    pycolmap = import_module("pycolmap")
    listing.write_text("".join(f"{first} {second}\n" for first, second in pairs), encoding="utf-8")
    pairing = pycolmap.ImportedPairingOptions(match_list_path=listing)
    pycolmap.match_image_pairs(folder / DATABASE, pairing_options=pairing, device=pycolmap.Device.cpu)


def _place_photos(folder: Path, count: int, work: Path, on_stage: OnStage) -> Any:
    """The model with the most photos; None where there is none. `work` is a folder to be made."""
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
    work.mkdir()
    models = pycolmap.incremental_mapping(
        folder / DATABASE, folder / "images", work, options, next_image_callback=tell_next
    )
    return max(models.values(), key=lambda model: model.num_reg_images(), default=None)
