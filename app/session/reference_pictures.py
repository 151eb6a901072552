"""Photos of dataset cameras and their masks, read in the background to compare the splats with."""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from instdrive_app.messages import read_error
from instdrive_app.state import Reference
from instdrive_core.datasets.photos import load_photo, read_photo_size
from instdrive_core.errors import DataError, InstDriveError
from instdrive_core.instances.colormap import colors_from_ids
from instdrive_core.masks.label_map_folder import SIDECAR, FrameMasks, open_masks
from instdrive_core.scene.camera import CameraView
from instdrive_core.wording import phrase

_log = logging.getLogger(__name__)
MAX_PICTURES = 16
"""Pictures kept in memory, so that going a few steps back and forth reads nothing again."""
MAX_WIDTH = 1920
"""Pixels; wider photos are scaled down."""
SKY_COLOR = (120, 170, 220)
MASK_LEVELS = 4
"""Number of folders above a photo that are searched for its clip's masks."""

Picture = UInt8[ndarray, "h w 4"]
_Key = tuple[str, str, int, Reference]


class ReferencePictures:
    """Reads one picture at a time on a thread of its own, and keeps the last ones."""

    def __init__(self, report_error: Callable[[str], None], wake: Callable[[], None] = lambda: None) -> None:
        """`report_error` gets a text for the user, once per picture; `wake` is called when a picture is there."""
        self._report_error, self._wake = report_error, wake
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="reference")
        self._pictures: OrderedDict[_Key, Future[Picture]] = OrderedDict()
        self._told: set[_Key] = set()
        self._last: tuple[str, Reference, Picture] | None = None

    def get(self, view: CameraView, kind: Reference) -> Picture | None:
        """Return RGBA of the view's photo or masks; None where there is none.

        While it is being read this is the camera's last one, so that nothing flickers as the drive plays, or None.
        """
        key = _build_key(view, kind)
        if key not in self._pictures:
            self._request(key, view, kind)
        self._pictures.move_to_end(key)
        future = self._pictures[key]
        if not future.done():
            return self._last[2] if self._last is not None and self._last[:2] == (view.name, kind) else None
        error = future.exception()
        if error is None:
            self._last = (view.name, kind, future.result())
            return future.result()
        if key not in self._told:
            self._told.add(key)
            if not isinstance(error, InstDriveError):
                _log.error("reading %s failed", key, exc_info=error)
                self._report_error(
                    phrase(
                        "{name}/{index:02d} cannot be shown: {error!r}. Help › Log file has more",
                        name=view.name,
                        index=view.index,
                        error=error,
                    )
                )
            elif not _is_held_back(view, kind):
                self._report_error(read_error(error))
        return None

    def explain_missing(self, view: CameraView, kind: Reference) -> str:
        """Explain in a few words why a view has no such picture; empty where it has one, or is still being read."""
        future = self._pictures.get(_build_key(view, kind))
        if future is None or not future.done() or future.exception() is None:
            return ""
        return "Held out from training: no masks" if _is_held_back(view, kind) else "Not available"

    @property
    def is_reading(self) -> bool:
        """Whether a picture is being read."""
        return any(not future.done() for future in self._pictures.values())

    def forget(self) -> None:
        """Forget all pictures, since another document is open."""
        self._pictures.clear()
        self._told.clear()
        self._last = None

    def close(self) -> None:
        """Stop the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _request(self, key: _Key, view: CameraView, kind: Reference) -> None:
        for old in [old for old, future in self._pictures.items() if not future.running() and not future.done()]:
            self._pictures.pop(old).cancel()  # the user has moved on
        future = self._pool.submit(load_reference_picture, view, kind)
        future.add_done_callback(lambda _: self._wake())
        self._pictures[key] = future
        while len(self._pictures) > MAX_PICTURES:
            self._pictures.popitem(last=False)


def _build_key(view: CameraView, kind: Reference) -> _Key:
    return view.photo, view.name, view.index, kind


def _is_held_back(view: CameraView, kind: Reference) -> bool:
    """Whether a picture is expected to be missing: only photos used in training have masks."""
    return kind is Reference.MASKS and view.held_out


def load_reference_picture(view: CameraView, kind: Reference) -> Picture:
    """Read RGBA of a view's photo (opaque) or of its masks (transparent where there is none).

    Raises DataError where the scene does not know the photo, or the file is missing or damaged.
    """
    if not view.photo:
        raise DataError(f"{view.name}/{view.index:02d}", "the scene does not record where this photo is", _REMEDY)
    photo = Path(view.photo)
    if kind is Reference.MASKS:
        return color_masks(open_masks(find_masks(photo)).load(f"{view.name}/{view.index:02d}"))
    if not photo.is_file():
        raise DataError(photo, "the photo is no longer there", _REMEDY)
    full = read_photo_size(photo)
    factor = min(1.0, MAX_WIDTH / full[0])
    rgb = load_photo(photo, full, (max(1, round(full[0] * factor)), max(1, round(full[1] * factor))))
    return np.concatenate([rgb, np.full((*rgb.shape[:2], 1), 255, np.uint8)], axis=2)


def find_masks(photo: Path) -> Path:
    """Find the mask folder of the clip that a photo belongs to.

    Raises DataError where no folder above the photo has one, or the clip is gone.
    """
    for folder in list(photo.parents)[:MASK_LEVELS]:
        if (folder / "masks" / SIDECAR).is_file():
            return folder / "masks"
    if not photo.is_file():
        raise DataError(photo, "its clip and masks are no longer there", _REMEDY)
    raise DataError(photo, "its clip has no folder masks/", "Write masks with `instdrive masks`")


def color_masks(masks: FrameMasks) -> Picture:
    """Draw a photo's masks: a colour each, darker at the border; the sky light blue; transparent where unknown."""
    labels = masks.labels.astype(np.uint32)
    picture = np.zeros((*labels.shape, 4), np.uint8)
    picture[..., :3] = colors_from_ids(labels)
    picture[..., 3] = np.where(labels > 0, 255, 0)
    picture[masks.sky] = (*SKY_COLOR, 255)
    border = np.zeros(labels.shape, bool)
    border[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    border[1:] |= labels[1:] != labels[:-1]
    picture[border, :3] //= 3
    return picture


_REMEDY = "Open the run where its clip is, or train it again"
