"""Writing SOG scenes, version 2, as archives or folders: the counterpart of `scenes`, which says what is lost."""

from __future__ import annotations

import hashlib
import io
import json
import math
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int64, UInt8
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically, write_bytes
from instdrive_core.formats.export_checks import check_numbers, check_static
from instdrive_core.formats.plausible_count import check_plausible_count
from instdrive_core.formats.sog.meta import PALETTE_LIMIT
from instdrive_core.formats.sog.palettes import choose_codebook, choose_palette, find_codes
from instdrive_core.formats.sog.scenes import FIRST_TAG, META, OTHERS, PALETTE_COLUMNS
from instdrive_core.formats.spatial_order import sort_spatially
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.progress import report
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene

LOG_SCALE_LIMITS = (-87.0, 88.0)
FARTHEST = 1e30
"""Metres; readers refuse exponents beyond ±80."""
_RUN = 256
_IMAGE = re.compile(r"(means_l|means_u|quats|scales|sh0|shN_centroids|shN_labels)\.[0-9a-f]{8}\.webp")


def write_sog(path: str | Path, scene: Scene) -> None:
    """Write a scene at one moment, atomically; rows are put in spatial order, what has no place is left out.

    Raises DataError where the scene has moving actors, no splats, or values that are no numbers or too far away.
    """
    check_for_sog(path, scene, ".sog")
    files = pack_sog(scene.gaussians.select(order_for_sog(scene.gaussians.means)), scene.antialiased)
    with open_atomically(path) as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
            for name, data in files.items():
                # A ZipInfo has a fixed date, so that equal scenes make equal files.
                archive.writestr(zipfile.ZipInfo(name), data)
        file.seek(0, 2)
        check_plausible_count(path, len(scene), file.tell())


def write_sog_folder(path: str | Path, scene: Scene) -> None:
    """Write a meta.json, atomically, and its images beside it, under names that no older images have.

    Raises DataError where `write_sog` does.
    """
    path = Path(path)
    check_for_sog(path, scene, META)
    files = pack_sog(scene.gaussians.select(order_for_sog(scene.gaussians.means)), scene.antialiased)
    check_plausible_count(path, len(scene), sum(len(data) for data in files.values()))
    save_sog_files(path, files)
    for image in path.parent.iterdir():
        if _IMAGE.fullmatch(image.name) and image.name.encode() not in path.read_bytes():
            image.unlink()


def save_sog_files(path: Path, files: dict[str, bytes]) -> None:
    """Save what `pack_sog` made, the meta.json as `path` and last; digests of images become part of their names."""
    names = {name: _name_image(name, data) for name, data in files.items() if name != META}
    meta = json.loads(files[META])
    for entry in meta.values():
        if isinstance(entry, dict):
            entry["files"] = [names[name] for name in entry["files"]]
    new = [path.with_name(unique) for unique in names.values() if not path.with_name(unique).exists()]
    try:
        for name, unique in names.items():
            write_bytes(path.with_name(unique), files[name])
        write_bytes(path, json.dumps(meta).encode())
    except BaseException:
        for image in new:
            image.unlink(missing_ok=True)
        raise


def order_for_sog(means: Float[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
    """Row numbers in the order of the file: near splats near each other, which images of them compress well."""
    return sort_spatially(means.astype(np.float32, copy=False), _RUN)


def bound_position_error(means: Float[ndarray, "n 3"]) -> Float[ndarray, "n 3"]:
    """Bound the error of each coordinate, metres: half a step of the logarithms, and the rounding of float32."""
    logarithms = _compress_positions(means)
    half = np.ptp(logarithms, axis=0) / 65535 / 2
    return np.expm1(half) * (1 + np.abs(means.astype(np.float64))) * 1.001 + 1e-6 * np.abs(means) + 1e-12


def check_for_sog(path: str | Path, scene: Scene, suffix: str) -> None:
    """Check that a SOG can hold a scene. Raises DataError where it cannot, for the reasons that `write_sog` states."""
    check_static(path, scene, suffix)
    if not len(scene):
        raise DataError(path, "the scene has no splats, and images need a pixel", "Save as .ply instead")
    gaussians = scene.gaussians
    rows = np.arange(len(gaussians))
    for name in ("means", "quats", "sh_dc", "sh_rest"):
        check_numbers(path, name, getattr(gaussians, name), rows)
    for name in ("log_scales", "opacity_logits"):
        check_numbers(path, name, getattr(gaussians, name), rows, allow_infinite=True)
    farthest = float(np.abs(gaussians.means).max())
    if farthest > FARTHEST:
        problem = f"a splat lies {farthest:.6g} m from the scene's origin; .sog reaches {FARTHEST:g} m"
        raise DataError(path, problem, "Delete strays, or save as .ply")


def pack_sog(gaussians: Gaussians, antialiased: bool) -> dict[str, bytes]:
    """Pack Gaussians, row by row, as the files of one SOG scene by their names: the meta.json and its images."""
    meta: dict[str, Any] = {"version": 2, "count": len(gaussians), "antialias": antialiased}
    files: dict[str, bytes] = {}

    def add(entry: str, fields: dict[str, Any], images: dict[str, ndarray]) -> None:
        packed = {f"{name}.webp": _encode_webp(_arrange(pixels)) for name, pixels in images.items()}
        files.update(packed)
        meta[entry] = fields | {"files": list(packed)}

    logarithms = _compress_positions(gaussians.means)
    low, high = logarithms.min(axis=0), logarithms.max(axis=0)
    steps = np.rint((logarithms - low) / np.where(high > low, high - low, 1) * 65535).astype(np.int64)
    bounds = {"mins": low.tolist(), "maxs": high.tolist()}
    add("means", bounds, {"means_l": steps % 256, "means_u": steps // 256})
    report(0.2)
    add("quats", {}, {"quats": _pack_rotations(gaussians.quats)})
    scales = np.clip(gaussians.log_scales, *LOG_SCALE_LIMITS)
    codes = choose_codebook(scales.ravel())
    add("scales", {"codebook": codes.tolist()}, {"scales": find_codes(scales, codes)})
    report(0.4)
    codes = choose_codebook(gaussians.sh_dc.ravel())
    alphas = np.rint(255 * sigmoid(gaussians.opacity_logits.astype(np.float64)))[:, None]
    colors = np.column_stack([find_codes(gaussians.sh_dc, codes), alphas])
    add("sh0", {"codebook": codes.tolist()}, {"sh0": colors})
    report(0.5)
    if gaussians.sh_degree:
        rest = gaussians.sh_rest.shape[1]
        palette, labels = choose_palette(gaussians.sh_rest.reshape(len(gaussians), -1), PALETTE_LIMIT)
        codes = choose_codebook(palette.ravel())
        image = np.full((-(-len(palette) // PALETTE_COLUMNS) * PALETTE_COLUMNS, rest, 4), 255, np.uint8)
        image[: len(palette), :, :3] = find_codes(palette, codes).reshape(-1, rest, 3)
        files["shN_centroids.webp"] = _encode_webp(image.reshape(-1, PALETTE_COLUMNS * rest, 4))
        files["shN_labels.webp"] = _encode_webp(_arrange(np.column_stack([labels % 256, labels // 256])))
        fields = {"count": len(palette), "bands": gaussians.sh_degree, "codebook": codes.tolist()}
        meta["shN"] = fields | {"files": ["shN_centroids.webp", "shN_labels.webp"]}
    return {META: json.dumps(meta).encode(), **files}


def _name_image(name: str, data: bytes) -> str:
    stem, suffix = name.split(".")
    return f"{stem}.{hashlib.sha256(data).hexdigest()[:8]}.{suffix}"


def _compress_positions(means: ndarray) -> ndarray:
    wide = means.astype(np.float64)
    return np.sign(wide) * np.log1p(np.abs(wide))


def _pack_rotations(quats: ndarray) -> ndarray:
    units = normalize_quaternions(quats.astype(np.float64))
    largest = np.argmax(np.abs(units), axis=1)[:, None]
    units = units * np.where(np.take_along_axis(units, largest, axis=1) < 0, -1, 1)
    others = np.take_along_axis(units, OTHERS[largest[:, 0]], axis=1)
    stored = np.clip(np.rint((others * math.sqrt(2) + 1) * 127.5), 0, 255)
    return np.column_stack([stored, FIRST_TAG + largest])


def _arrange(values: ndarray) -> UInt8[ndarray, "h w 4"]:
    """Lay rows of up to four bytes out as an image that is about square, with sides of whole blocks of 4 pixels."""
    width = 4 * math.ceil(math.sqrt(len(values)) / 4)
    height = 4 * math.ceil(len(values) / width / 4)
    pixels = np.zeros((height * width, 4), np.uint8)
    pixels[:, 3] = 255
    pixels[: len(values), : values.shape[1]] = values
    return pixels.reshape(height, width, 4)


def _encode_webp(pixels: ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "WEBP", lossless=True, exact=True)
    return file.getvalue()
