"""A recording on the disk: a file per product, each whole or absent, a view's own listing after its files.

Layout::

    plan.json                     what is recorded, written first; the same plan goes on where it was stopped
    color/<camera>/NN.png         RGB
    instances/<camera>/NN.png     the editor's IDs: 16-bit grey; R + 256 G + 65536 B where an ID needs more
    classes/<camera>/NN.png       numbers of the manifest's classes: 16-bit grey, 0 = none
    depth/<camera>/NN.png         millimetres along the viewing axis: 16-bit grey, 0 = nothing, 65535 = that or farther
    depth/<camera>/NN.npz         'depth': the same in metres, float32, without an end; or .exr, channel Z
    flow/<camera>/NN.npz          'flow': pixels right and down to the camera's next picture, 'valid'; on request
    confidence/<camera>/NN.png    255 = all that is shown was seen by enough photos: 8-bit grey; on request
    lidar/NN.npz                  'points', 'intensity', 'times', 'instances', 'world_from_lidar'; where sweeps are cast
    views/<camera>/NN.json        camera, 2D boxes and visibility; names the view's files and their sizes
    moments/NN.json               3D boxes
    videos/<look>/<camera>.mp4    and all_cameras.mp4; where videos are asked for
    recording.json                the manifest: conventions, instances, classes, all views; written last
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8, UInt16, UInt32
from numpy import ndarray
from PIL import Image

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.json_fields import read_json
from instdrive_core.masks.export.id_pictures import pack_ids
from instdrive_core.recording.depth_files import DepthFormat, encode_depth
from instdrive_core.recording.plan import describe_view
from instdrive_core.recording.views import RecordedView
from instdrive_core.scene.camera import CameraView

PLAN, MANIFEST, LOCK = "plan.json", "recording.json", ".lock"
FORMAT, VERSION = "instdrive recording", 1
FARTHEST_MM = 65535
_PNG_LEVEL = 1
"""Effort of zlib: higher ones take several times as long and save a tenth."""


def name_file(kind: str, view: CameraView, suffix: str) -> str:
    """Name a view's file of one kind, relative to the recording."""
    return name_of_file(kind, view.name, view.index, suffix)


def name_of_file(kind: str, camera: str, step: int, suffix: str) -> str:
    """Name the file of one kind that a camera has at a step, relative to the recording."""
    return f"{kind}/{camera}/{step:02d}{suffix}"


def name_moment(step: int) -> str:
    """Name the file of a moment's boxes, relative to the recording."""
    return f"moments/{step:02d}.json"


def write_view(folder: Path, recorded: RecordedView, packed: bool, depth_format: DepthFormat = "npz") -> None:
    """Write all files of a view, each atomically, its listing last.

    Args:
        folder: of the recording.
        recorded: the view.
        packed: whether IDs need three bytes; the same for all views.
        depth_format: of the depth in metres.

    Raises DataError where a file cannot be written, MissingExtraError where a package for the depth is missing.
    """
    view, sizes = recorded.view, {}

    def write(kind: str, suffix: str, content: bytes) -> None:
        name = name_file(kind, view, suffix)
        write_bytes(folder / name, content)
        sizes[name] = len(content)

    millimetres = np.minimum(np.round(recorded.depth * 1000), FARTHEST_MM).astype(np.uint16)
    ids = pack_ids(recorded.instances) if packed else recorded.instances.astype(np.uint16)
    write("color", ".png", _encode_png(recorded.color))
    write("instances", ".png", _encode_png(ids))
    write("classes", ".png", _encode_png(recorded.classes))
    write("depth", ".png", _encode_png(millimetres))
    write("depth", f".{depth_format}", encode_depth(recorded.depth, depth_format))
    if recorded.flow is not None:
        write("flow", ".npz", _encode_arrays(flow=recorded.flow.flow, valid=recorded.flow.valid))
    facts: dict[str, Any] = {}
    if recorded.confidence is not None and recorded.confidence_facts is not None:
        share = np.round(np.clip(recorded.confidence, 0, 1) * 255).astype(np.uint8)
        write("confidence", ".png", _encode_png(share))
        facts = {"confidence": asdict(recorded.confidence_facts)}
    content = describe_view(view) | facts | {"files": sizes, "objects": list(recorded.objects)}
    write_listing(folder / name_file("views", view, ".json"), content)


def is_view_whole(folder: Path, view: CameraView) -> bool:
    """Whether a view was recorded wholly: its listing is there and all files have the listed sizes."""
    listing = folder / name_file("views", view, ".json")
    try:
        sizes = read_json(listing)["files"]
        return bool(sizes) and all((folder / name).stat().st_size == size for name, size in sizes.items())
    except (DataError, OSError, KeyError, TypeError, AttributeError):
        return False


def write_listing(path: Path, content: object) -> None:
    """Write JSON atomically. Raises DataError where it cannot be written."""
    write_bytes(path, (json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a finished recording. Raises DataError where there is none or it is another format."""
    path = folder / MANIFEST
    if not path.is_file():
        remedy = "Run `instdrive simulate` with the same arguments again: it goes on where it was stopped"
        raise DataError(folder, f"is no finished recording ('{MANIFEST}' is missing)", remedy)
    content = read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT or content.get("version") != VERSION:
        raise DataError(path, f"is no manifest of '{FORMAT}', version {VERSION}", "Record the drive again")
    return content


def read_id_map(path: Path) -> UInt32[ndarray, "h w"]:
    """Read instance IDs of either form. Raises DataError where the picture cannot be read."""
    pixels = _read_pixels(path)
    if pixels.ndim == 3:
        red, green, blue = (pixels[..., channel].astype(np.uint32) for channel in range(3))
        return red | green << 8 | blue << 16
    return pixels.astype(np.uint32)


def read_color(path: Path) -> UInt8[ndarray, "h w 3"]:
    """Read a colour picture. Raises DataError where it cannot be read."""
    return _read_pixels(path)


def read_share(path: Path) -> Float32[ndarray, "h w"]:
    """Read a confidence map, 0 … 1. Raises DataError where the picture cannot be read."""
    return _read_pixels(path).astype(np.float32) / 255


def check_folder(folder: Path, plan: dict[str, Any]) -> bool:
    """Check that a folder can take a recording; returns whether one of the same plan was begun there.

    Raises DataError where it is a file, holds something else, or another recording.
    """
    if not folder.exists():
        return False
    if not folder.is_dir():
        raise DataError(folder, "is a file, and many files are to be written", "Give the name of a folder")
    if (folder / PLAN).is_file():
        if read_json(folder / PLAN) == json.loads(json.dumps(plan)):
            return True
        problem = "holds a recording of another scene, or of other views or products"
        raise DataError(folder, problem, "Name another folder, or delete this one")
    if any(entry.name != LOCK for entry in folder.iterdir()):
        raise DataError(folder, "is not empty and holds no recording", "Name a new folder")
    return False


def list_missing(folder: Path, views: Sequence[CameraView]) -> list[CameraView]:
    """List the views that are not recorded yet, in their order."""
    return [view for view in views if not is_view_whole(folder, view)]


def _encode_png(pixels: UInt8[ndarray, "..."] | UInt16[ndarray, "..."]) -> bytes:
    packed = io.BytesIO()
    Image.fromarray(pixels).save(packed, "PNG", compress_level=_PNG_LEVEL)
    return packed.getvalue()


def _encode_arrays(**arrays: ndarray) -> bytes:
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays)  # pyright: ignore[reportArgumentType]
    return packed.getvalue()


def _read_pixels(path: Path) -> ndarray:
    try:
        with Image.open(path) as picture:
            return np.asarray(picture)
    except (OSError, ValueError, SyntaxError) as error:
        raise DataError(path, f"the picture cannot be read ({error})", "Record the drive again") from error
