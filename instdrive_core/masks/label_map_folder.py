"""Instance masks of photos on disk: label maps, sky masks and a sidecar that says where they come from.

Layout of a mask folder::

    masks.json                     version, source, faults, seed, and per frame its size and number of masks
    <camera>/NN.png                16-bit labels, 0 = none
    <camera>/NN_sky.png            8-bit, 255 = sky
    <camera>/NN_layer1.png         16-bit labels of a second layer, where masks overlap; then layer2 and so on

Labels mean nothing across frames: they are shuffled in each frame by its own random numbers, so that nothing can be
learned from them but which pixels belong together.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Integer, UInt16
from numpy import ndarray
from PIL import Image

from instdrive_core.datasets.clip import Frame
from instdrive_core.errors import DataError
from instdrive_core.files.atomic import replace_atomically, write_bytes
from instdrive_core.files.image_limit import BAD_IMAGE, check_pixels
from instdrive_core.files.json_fields import read_json, require_field, require_number
from instdrive_core.files.plain_file import BoundedReader
from instdrive_core.masks.journal import MaskJournal
from instdrive_core.maths.streams import Stream, make_generator

SIDECAR = "masks.json"
VERSION = 1
MAX_LAYERS = 8
_REMEDY = "Write the masks again with `instdrive masks`"


@dataclass(frozen=True)
class FrameMasks:
    """Masks and sky of one photo."""

    labels: UInt16[ndarray, "h w"]
    """Instance of this frame only; 0 = none."""
    sky: Bool[ndarray, "h w"]
    overlaps: tuple[UInt16[ndarray, "h w"], ...] = ()
    """Further label maps where masks overlap, each numbered by itself; `labels` has the smallest mask on top."""

    def resize(self, width: int, height: int) -> FrameMasks:
        """Take the nearest label for each pixel of another raster."""
        if self.labels.shape == (height, width):
            return self
        labels, sky, *overlaps = (
            resample_nearest(raster, width, height) for raster in (self.labels, self.sky, *self.overlaps)
        )
        return FrameMasks(labels, sky, tuple(overlaps))


@dataclass(frozen=True)
class MaskFolder:
    """An opened folder of masks; label maps are read when asked for."""

    path: Path
    source: str
    """Name of the source that made the masks, e.g. ``exact`` or ``annotations``."""
    seed: int
    counts: dict[str, int]
    """Number of masks by frame key; its keys are the frames that have masks."""
    faults: str | None = None
    """Name of the faults that were put into them (`faults.registry.FAULT_SETS`)."""
    layers: int = 1
    """Label maps of each frame."""

    def load(self, frame: Frame | str) -> FrameMasks:
        """Masks of a frame, resized to it; given a key (``camera/NN``), as they are on disk.

        Raises DataError where the frame has no masks or a file is missing or damaged.
        """
        key = frame if isinstance(frame, str) else frame.key
        if key not in self.counts:
            raise DataError(self.path / SIDECAR, f"the frame '{key}' has no masks", _REMEDY + " for all of its frames")
        sky_file = locate_sky_mask(self.path, key)
        sky = read_sky_mask(sky_file)
        maps = [_read_layer(locate_label_map(self.path, key, layer), sky_file, sky) for layer in range(self.layers)]
        masks = FrameMasks(maps[0], sky, tuple(maps[1:]))
        if isinstance(frame, str):
            return masks
        return masks.resize(frame.view.camera.width, frame.view.camera.height)


def write_masks(
    folder: str | Path,
    frames: Iterable[tuple[str, FrameMasks]],
    source: str,
    seed: int,
    faults: str | None = None,
    journal: MaskJournal | None = None,
) -> MaskFolder:
    """Write masks by frame key, one after the other, and the sidecar at the end: a folder without it is unfinished.

    Args:
        folder: where to.
        frames: key and masks of each frame.
        source: how they were made.
        seed: seed of their labels' order.
        faults: name of the faults that were put into them.
        journal: remembers what is written; the frames it knows already become part of the folder.

    Raises DataError where the folder cannot be written.
    """
    folder = Path(folder)
    journal = journal or MaskJournal(folder, None)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / SIDECAR).unlink(missing_ok=True)
        journal.begin()
        for key, masks in frames:
            for layer, labels in enumerate((masks.labels, *masks.overlaps)):
                _write_png(locate_label_map(folder, key, layer), labels)
            _write_png(locate_sky_mask(folder, key), masks.sky.astype(np.uint8) * 255)
            height, width = masks.labels.shape
            count = len(np.unique(masks.labels[masks.labels > 0]))
            layers = 1 + len(masks.overlaps)
            journal.add(
                key, {"width": width, "height": height, "masks": count} | ({"layers": layers} if layers > 1 else {})
            )
        entries = journal.entries
        layers = max((entry.get("layers", 1) for entry in entries.values()), default=1)
        sidecar = {"version": VERSION, "source": source, "faults": faults, "seed": seed, "frames": entries}
        sidecar |= {"layers": layers} if layers > 1 else {}
        write_bytes(folder / SIDECAR, json.dumps(sidecar, indent=1).encode())
        journal.close()
    except OSError as error:
        remedy = "Choose a folder that can be written, e.g. with --out"
        raise DataError(folder, f"cannot be written ({error.strerror or error})", remedy) from error
    return MaskFolder(folder, source, seed, {key: entry["masks"] for key, entry in entries.items()}, faults, layers)


def open_masks(folder: str | Path) -> MaskFolder:
    """Open a folder of masks. Raises DataError where it is none or its sidecar is damaged."""
    folder = Path(folder)
    file = folder / SIDECAR
    if not file.is_file():
        raise DataError(folder, f"is no finished folder of masks: '{SIDECAR}' is missing", _REMEDY)
    sidecar = read_json(file)
    version = require_field(file, sidecar, "version")
    if version != VERSION:
        raise DataError(file, f"has version {version!r}, this program reads {VERSION}", _REMEDY)
    frames = require_field(file, sidecar, "frames")
    if not isinstance(frames, dict):
        raise DataError(file, "the field 'frames' is no object", _REMEDY)
    counts = {
        _check_key(file, key): int(
            require_number(file, require_field(file, entry, "masks", f"frames.{key}."), f"frames.{key}.masks")
        )
        for key, entry in frames.items()
    }
    seed = int(require_number(file, require_field(file, sidecar, "seed"), "seed"))
    faults = sidecar.get("faults")  # older sidecars do not have it
    if faults is not None and not isinstance(faults, str):
        raise DataError(file, f"the field 'faults' is {faults!r}, expected a name", _REMEDY)
    layers = int(require_number(file, sidecar.get("layers", 1), "layers"))
    if not 1 <= layers <= MAX_LAYERS:
        raise DataError(file, f"the field 'layers' is {layers}, expected 1 to {MAX_LAYERS}", _REMEDY)
    return MaskFolder(folder, str(require_field(file, sidecar, "source")), seed, counts, faults, layers)


def shuffle_labels(instances: Integer[ndarray, "h w"], key: str, seed: int) -> UInt16[ndarray, "h w"]:
    """Give labels 1…n in random order to the n instances (> 0) of a frame; the order depends on seed and frame key
    only.

    Raises ValueError for more instances than 16 bits hold.
    """
    present, positions = np.unique(instances, return_inverse=True)
    count = int((present > 0).sum())
    if count > np.iinfo(np.uint16).max:
        raise ValueError(f"{count} instances in one frame do not fit into 16 bits")
    rng = make_generator(seed, Stream.MASK_LABELS, zlib.crc32(key.encode()))
    labels = np.zeros(len(present), np.uint16)
    labels[present > 0] = rng.permutation(count) + 1
    return labels[positions].reshape(instances.shape)


def resample_nearest(raster: ndarray, width: int, height: int) -> ndarray:
    """Sample a raster (h, w) at the pixel centres of a raster of another size."""
    if raster.shape == (height, width):
        return raster
    rows = ((np.arange(height) + 0.5) * raster.shape[0] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * raster.shape[1] / width).astype(int)
    return raster[rows[:, None], columns[None, :]]


def locate_label_map(folder: Path, key: str, layer: int = 0) -> Path:
    """File of a frame's label map, or of a further layer of it."""
    return folder / (f"{key}_layer{layer}.png" if layer else f"{key}.png")


def locate_sky_mask(folder: Path, key: str) -> Path:
    """File of a frame's sky mask."""
    return folder / f"{key}_sky.png"


def read_label_map(file: Path) -> Integer[ndarray, "h w"]:
    """Read a grey PNG of 8 or 16 bits as it is. Raises DataError where it is missing, damaged or of another kind."""
    raster, mode = _read_png(file)
    if mode not in ("L", "I;16", "I"):
        raise DataError(file, f"has the image mode {mode}, expected 16-bit grey", _REMEDY)
    return raster


def read_sky_mask(file: Path) -> Bool[ndarray, "h w"]:
    """Read a sky mask: 0 = no sky. Raises DataError where it is missing, damaged or of another kind."""
    raster, mode = _read_png(file)
    if mode not in ("L", "1"):
        raise DataError(file, f"has the image mode {mode}, expected 8-bit grey", _REMEDY)
    return raster > 0


def _read_layer(file: Path, sky_file: Path, sky: Bool[ndarray, "h w"]) -> UInt16[ndarray, "h w"]:
    labels = read_label_map(file)
    if labels.shape != sky.shape:
        problem = f"is {sky.shape[1]}×{sky.shape[0]}, the label map {labels.shape[1]}×{labels.shape[0]}"
        raise DataError(sky_file, problem, _REMEDY)
    if labels.max(initial=0) > np.iinfo(np.uint16).max:
        raise DataError(file, f"holds the label {labels.max()}, expected 16 bits", _REMEDY)
    return labels.astype(np.uint16)


def _read_png(file: Path) -> tuple[ndarray, str]:
    try:
        with BoundedReader(file) as stream, Image.open(stream) as image:
            check_pixels(file, image.size)
            return np.asarray(image), image.mode
    except FileNotFoundError as error:
        raise DataError(file, "is missing", _REMEDY) from error
    except BAD_IMAGE as error:
        raise DataError(file, f"is no readable PNG ({error})", _REMEDY) from error


def _write_png(file: Path, raster: ndarray) -> None:
    with replace_atomically(file) as temporary:
        Image.fromarray(raster).save(temporary, "PNG")


def _check_key(file: Path, key: str) -> str:
    """A key becomes part of a path: it must stay in the folder."""
    parts = key.split("/")
    if len(parts) != 2 or any(part in ("", ".", "..") or "\\" in part for part in parts):
        raise DataError(file, f"the frame '{key}' is no 'camera/number'", _REMEDY)
    return key
