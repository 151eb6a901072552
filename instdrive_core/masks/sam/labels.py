"""Masks by Segment Anything: no annotations and no LiDAR needed, but weights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import OptionError
from instdrive_core.masks.image.sky_finder import SkyFinder
from instdrive_core.masks.sam.options import SamOptions
from instdrive_core.masks.sam.regions import clean_regions, merge_parts, paint_regions
from instdrive_core.masks.sam.weights import find_weights, load_model

if TYPE_CHECKING:
    from instdrive_core.masks.sam.proposals import Proposer


class SamLabels:
    """Labels of a clip's photos; a photo's labels depend on nothing but the photo.

    Args:
        clip: the clip. Its LiDAR, if it has any, tells the sky; nothing else of it is used.
        options: how.

    Raises OptionError or DataError where weights, the transformers library or the GPU asked for are missing.
    """

    source = "sam"

    def __init__(self, clip: Clip, options: SamOptions = SamOptions()) -> None:  # noqa: B008 (frozen)
        self._options = options
        self._proposer = _open_proposer(options)
        self._sky = SkyFinder(clip)
        self._last: tuple[str, UInt32[ndarray, "h w"], Bool[ndarray, "h w"]] | None = None

    def load(self, frame: Frame) -> UInt32[ndarray, "h w"]:
        """Load a number per mask at the frame's size; 0 = none, sky or ego vehicle."""
        return self._load_both(frame)[0]

    def load_sky(self, frame: Frame) -> Bool[ndarray, "h w"]:
        """Load the sky at the frame's size."""
        return self._load_both(frame)[1]

    def _load_both(self, frame: Frame) -> tuple[UInt32[ndarray, "h w"], Bool[ndarray, "h w"]]:
        """Labels and sky. The last frame's are kept."""
        if self._last is None or self._last[0] != frame.key:
            self._last = (frame.key, *self._make(frame))
        return self._last[1], self._last[2]

    def _make(self, frame: Frame) -> tuple[UInt32[ndarray, "h w"], Bool[ndarray, "h w"]]:
        from instdrive_core.masks.sam.proposals import build_grid

        options, image = self._options, frame.load_image()
        height, width = image.shape[:2]
        valid = frame.valid if frame.valid is not None else np.ones((height, width), bool)
        min_pixels = max(1, round(options.min_area * height * width))
        points = build_grid(width, height, options.points_per_side)
        points = points[valid[points[:, 1].astype(int), points[:, 0].astype(int)]]
        found = self._proposer.propose(image, points, min_pixels, prefer_large=options.whole_objects)
        found = clean_regions(found, valid, min_pixels)
        if options.whole_objects:
            found = merge_parts(found, options.containment)
        labels = paint_regions(found, min_pixels)
        sky = self._sky.find(image, frame.view.camera, labels) & valid
        return np.where(sky, np.uint32(0), labels), sky


def _open_proposer(options: SamOptions) -> Proposer:
    folder = find_weights(options.model, options.offline)
    from instdrive_core.masks.sam.proposals import Proposer, Thresholds

    device = _choose_device(options.device)
    thresholds = Thresholds(options.predicted_iou, options.stability, options.overlap)
    model, photo = load_model(folder)
    return Proposer(model, photo, device, options.batch, thresholds)


def _choose_device(asked: Literal["auto", "cpu", "cuda"]) -> str:
    """Choose the device. Raises OptionError where the GPU asked for cannot be used."""
    import torch

    if asked == "cuda" and not torch.cuda.is_available():
        raise OptionError(
            "The device 'cuda' was asked for, but torch sees no NVIDIA GPU: "
            "install torch with CUDA and a driver (see docs/gpu.md), or use the device 'cpu'"
        )
    return "cuda" if asked != "cpu" and torch.cuda.is_available() else "cpu"
