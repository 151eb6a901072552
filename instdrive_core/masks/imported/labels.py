"""Masks made elsewhere, a file per photo: ``<camera>/NN.png``, ``.npz`` or ``.json`` (docs/masks.md)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError
from instdrive_core.masks.image.sky_finder import SkyFinder
from instdrive_core.masks.imported.checks import check_size
from instdrive_core.masks.imported.label_map import read_imported_label_map
from instdrive_core.masks.imported.npz import read_imported_npz
from instdrive_core.masks.imported.rle import read_imported_rle
from instdrive_core.masks.label_map_folder import locate_sky_mask, read_sky_mask, resample_nearest

READERS: dict[str, Callable[[Path, int, int], UInt32[ndarray, "h w"]]] = {
    ".png": read_imported_label_map,
    ".npz": read_imported_npz,
    ".json": read_imported_rle,
}
"""Readers by the ending of a file's name."""
MOSTLY = 0.5
"""Share of a mask from which on it counts as a mask of the sky, which is no instance."""


class ImportedLabels:
    """Masks read from a folder, checked, at the photos' size.

    The sky is ``NN_sky.png`` beside a photo's masks (255 = sky) if there is one; else masks of the sky are found as
    those of a segmenter.

    Args:
        clip: whose photos they are of.
        folder: where they lie.

    Raises DataError where a training photo has no file, or more than one; `load` and `sky` where a file is damaged or
    cannot be of its photo.
    """

    source = "import"

    def __init__(self, clip: Clip, folder: Path) -> None:
        self._clip, self._folder = clip, folder
        self._files = _find_files(clip, folder)
        self._sky_finder: SkyFinder | None = None
        self._last: tuple[str, UInt32[ndarray, "h w"], Bool[ndarray, "h w"]] | None = None

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load a number per mask at the frame's size; 0 = none, sky or ego vehicle."""
        return self._read(frame)[0]

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"]:
        """Load the sky at the frame's size."""
        return self._read(frame)[1]

    def _read(self, frame: Frame) -> tuple[UInt32[ndarray, "h w"], Bool[ndarray, "h w"]]:
        """Labels and sky. The last frame's are kept."""
        if self._last is None or self._last[0] != frame.key:
            file = self._files[frame.key]
            labels = READERS[file.suffix](file, frame.view.camera.width, frame.view.camera.height)
            if frame.valid is not None:
                labels = np.where(frame.valid, labels, np.uint32(0))
            sky = self._find_sky(frame, labels)
            sizes = np.bincount(labels.ravel())
            of_sky = np.bincount(labels.ravel(), sky.ravel()) >= MOSTLY * sizes
            self._last = frame.key, np.where(sky | of_sky[labels], np.uint32(0), labels), sky
        return self._last[1], self._last[2]

    def _find_sky(self, frame: Frame, labels: UInt32[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
        file, camera = locate_sky_mask(self._folder, frame.key), frame.view.camera
        if file.is_file():
            sky = read_sky_mask(file)
            check_size(file, "the sky mask", (sky.shape[1], sky.shape[0]), (camera.width, camera.height))
            return resample_nearest(sky, camera.width, camera.height)
        self._sky_finder = self._sky_finder or SkyFinder(self._clip)
        sky = self._sky_finder.find(frame.load_image(), camera, labels)
        return sky if frame.valid is None else sky & frame.valid


def _find_files(clip: Clip, folder: Path) -> dict[str, Path]:
    """The file of each training photo's masks, by frame key."""
    found = {frame.key: _find_file(folder, frame) for frame in clip.training_frames}
    missing = [key for key, file in found.items() if file is None]
    if missing:
        problem = f"{len(missing)} of {len(found)} training photos have no masks, the first is {missing[0]}"
        remedy = f"Give each photo a file CAMERA/NN ({', '.join(READERS)}), or choose fewer with --cameras"
        raise DataError(folder, problem, remedy)
    return {key: file for key, file in found.items() if file is not None}


def _find_file(folder: Path, frame: Frame) -> Path | None:
    """The file with a frame's masks."""
    found = [file for ending in READERS if (file := folder / f"{frame.key}{ending}").is_file()]
    if len(found) > 1:
        problem = f"the photo {frame.key} has {len(found)} files with masks: {', '.join(file.name for file in found)}"
        raise DataError(folder, problem, "Remove all but one")
    return found[0] if found else None
