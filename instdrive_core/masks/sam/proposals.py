"""Segment Anything asked at every point of a grid: one photo becomes hundreds of masks that may overlap.

The model is driven without the library's image processors, as most of them need torchvision. What is done is what its
mask-generation pipeline does, but for two things: points cover the photo for models that stretch it to a square (the
pipeline leaves out the lower part of wide photos there), and masks are brought to the photo's size in one step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Float64, Int64, UInt8
from numpy import ndarray
from PIL import Image
from torch import Tensor
from torch.nn import Module
from torch.nn.functional import grid_sample

from instdrive_core.masks.sam.regions import Regions, select_distinct
from instdrive_core.masks.sam.weights import PhotoFormat

STABILITY_OFFSET = 1.0
"""Logits by which the border of a stable mask may be moved with little change."""
SAMPLES_AT_ONCE = 1 << 24
"""Mask pixels held as floats at a time."""


@dataclass(frozen=True)
class Thresholds:
    """Values that a mask must reach."""

    predicted_iou: float
    stability: float
    overlap: float
    """IoU of boxes above which two masks are duplicates."""


class Proposer:
    """A model on its device.

    Args:
        model: one that generates masks, from `load_model`.
        photo: how it wants its photos.
        device: where it runs.
        batch: points asked at a time.
        thresholds: what masks must reach.
    """

    def __init__(self, model: Module, photo: PhotoFormat, device: str, batch: int, thresholds: Thresholds) -> None:
        self._model: Any = model.to(device)
        self._photo, self._device, self._batch, self._thresholds = photo, device, batch, thresholds

    @torch.inference_mode()
    def propose(
        self, image: UInt8[ndarray, "h w 3"], points: Float64[ndarray, "p 2"], min_pixels: int, prefer_large: bool
    ) -> Regions:
        """Find masks at the points, without duplicates, best first.

        Args:
            image: the photo.
            points: column and row, in pixels.
            min_pixels: what is smaller is left out.
            prefer_large: among masks of one extent that score alike, keep the largest.
        """
        height, width = image.shape[:2]
        content = compute_content_size(self._photo, height, width)
        pixels = torch.from_numpy(prepare_photo(image, self._photo))[None].to(self._device)
        embeddings = self._embeddings(pixels)
        asked = torch.from_numpy(points * (np.array(content[::-1]) / (width, height))).float().to(self._device)
        found = _Found([], [], [], [])
        for start in range(0, len(points), self._batch):
            part = asked[start : start + self._batch]
            labels = torch.ones((1, len(part), 1), dtype=torch.long, device=self._device)
            output = self._model(**embeddings, input_points=part[None, :, None], input_labels=labels)
            scores = output.iou_scores.reshape(-1)
            logits = output.pred_masks.reshape(len(scores), *output.pred_masks.shape[-2:])
            self._gather(logits, scores, (content[0] / self._photo.size, content[1] / self._photo.size), found, image)
        return found.best(image.shape[:2], self._thresholds.overlap, min_pixels, prefer_large)

    def _embeddings(self, pixels: Float[Tensor, "1 3 s s"]) -> dict[str, Any]:
        found = self._model.get_image_embeddings(pixels)
        if isinstance(found, tuple):  # sam_hq also looks at its encoder's earlier layers
            return {"image_embeddings": found[0], "intermediate_embeddings": found[1]}
        return {"image_embeddings": found}

    def _gather(
        self,
        logits: Float[Tensor, "n a b"],
        scores: Float[Tensor, " n"],
        content: tuple[float, float],
        found: _Found,
        image: UInt8[ndarray, "h w 3"],
    ) -> None:
        """Add what is good enough to what was found."""
        good = scores > self._thresholds.predicted_iou
        logits, scores = logits[good], scores[good]
        at_once = max(1, SAMPLES_AT_ONCE // (image.shape[0] * image.shape[1]))
        for start in range(0, len(scores), at_once):
            large = resize_logits(logits[start : start + at_once], content, image.shape[0], image.shape[1])
            stable = compute_stability(large) > self._thresholds.stability
            found.add((large[stable] > 0).cpu().numpy(), scores[start : start + at_once][stable].cpu().numpy())


@dataclass(frozen=True)
class _Found:
    """Masks found so far, a bit per pixel: there may be thousands before duplicates go."""

    bits: list[UInt8[ndarray, " b"]]
    boxes: list[tuple[int, int, int, int]]
    areas: list[int]
    scores: list[float]

    def add(self, masks: Bool[ndarray, "n h w"], scores: Float32[ndarray, " n"]) -> None:
        for mask, score in zip(masks, scores.tolist(), strict=True):
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            if len(rows):
                self.bits.append(np.packbits(mask))
                self.boxes.append((int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1))
                self.areas.append(int(mask.sum()))
                self.scores.append(score)

    def best(self, shape: tuple[int, ...], overlap: float, min_pixels: int, prefer_large: bool) -> Regions:
        areas, scores = np.array(self.areas, np.int64), np.array(self.scores, np.float32)
        boxes = np.array(self.boxes, np.float32).reshape(-1, 4)
        large: Int64[ndarray, " n"] = np.flatnonzero(areas >= min_pixels)
        kept = large[select_distinct(boxes[large], areas[large], scores[large], overlap, prefer_large)]
        count = int(np.prod(shape))
        masks = [np.unpackbits(self.bits[number], count=count).astype(bool).reshape(shape) for number in kept]
        return Regions(np.array(masks, bool).reshape(-1, *shape), scores[kept])


def build_grid(width: int, height: int, per_side: int) -> Float64[ndarray, "p 2"]:
    """Build columns and rows, in pixels, of per_side × per_side points in the middle of equal cells, row by row."""
    shares = (np.arange(per_side) + 0.5) / per_side
    columns, rows = np.meshgrid(shares * width, shares * height)
    return np.stack([columns.ravel(), rows.ravel()], axis=1)


def compute_content_size(photo: PhotoFormat, height: int, width: int) -> tuple[int, int]:
    """Compute height and width that a photo gets in the square the model looks at."""
    if not photo.keeps_shape:
        return photo.size, photo.size
    scale = photo.size / max(height, width)
    return max(1, int(height * scale + 0.5)), max(1, int(width * scale + 0.5))


def prepare_photo(image: UInt8[ndarray, "h w 3"], photo: PhotoFormat) -> Float32[ndarray, "3 s s"]:
    """Prepare a photo as the model looks at it: resized, normalised, padded with zeros."""
    height, width = compute_content_size(photo, *image.shape[:2])
    resized = np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR), np.float32)
    normal = (resized / np.float32(255) - np.array(photo.mean, np.float32)) / np.array(photo.std, np.float32)
    square = np.zeros((3, photo.size, photo.size), np.float32)
    square[:, :height, :width] = normal.transpose(2, 0, 1)
    return square


def resize_logits(
    logits: Float[Tensor, "n a b"], content: tuple[float, float], height: int, width: int
) -> Float[Tensor, "n h w"]:
    """Resize logits to the photo's pixel centres, bilinearly; `content` = share of the square's height and width it
    takes."""
    rows = (torch.arange(height, device=logits.device) + 0.5) / height * (2 * content[0]) - 1
    columns = (torch.arange(width, device=logits.device) + 0.5) / width * (2 * content[1]) - 1
    places = torch.stack(torch.meshgrid(columns, rows, indexing="xy"), dim=-1)
    return grid_sample(logits[None], places[None], mode="bilinear", padding_mode="border", align_corners=False)[0]


def compute_stability(logits: Float[Tensor, "n h w"]) -> Float[Tensor, " n"]:
    """Compute the IoU of each mask with a high and with a low threshold: 1 = a sharp border. 0 for empty masks."""
    inner = (logits > STABILITY_OFFSET).sum(dim=(1, 2))
    outer = (logits > -STABILITY_OFFSET).sum(dim=(1, 2))
    return inner / outer.clamp(min=1)
