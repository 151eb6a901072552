"""Overlapping masks of a segmenter become one label per pixel.

A segmenter asked at every point of a grid answers with wheels, doors and cars alike. Here duplicates go, parts join the
whole that contains them, and what is left is painted, small over large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, UInt32
from numpy import ndarray
from scipy import ndimage

SAME_EXTENT = 0.9
"""IoU of boxes from which on two masks are the same thing, one of them filled better."""
SCORE_MARGIN = 0.05
"""A mask that scores lower than another by more than this is not trusted to be its whole."""
LARGEST_WHOLE = 0.5
"""Share of the photo beyond which a mask is the scene rather than an object, and takes in nothing."""
GROUP_COVER = 0.9
"""Share of a mask that several others cover, from which on it may be a group of them."""
MAIN_SHARE = 0.6
"""A mask with a part larger than this share of it is an object with its parts, not a group."""
BLOCK = 1 << 16
"""Pixels compared at a time; bounds the memory, and counts within a block are exact in 32-bit floats."""


@dataclass(frozen=True)
class Regions:
    """Masks of one photo, which may overlap."""

    masks: Bool[ndarray, "n h w"]
    scores: Float32[ndarray, " n"]
    """Quality that the segmenter predicts for each: its IoU."""

    def __len__(self) -> int:
        return len(self.masks)

    def select(self, kept: ndarray) -> Regions:
        """Select those that an index array or a boolean array names."""
        return Regions(self.masks[kept], self.scores[kept])


def select_distinct(
    boxes: Float32[ndarray, "n 4"],
    areas: Int64[ndarray, " n"],
    scores: Float32[ndarray, " n"],
    overlap: float,
    prefer_large: bool,
) -> Int64[ndarray, " m"]:
    """Select positions of masks to keep, best score first: non-maximum suppression on boxes.

    Args:
        boxes: left, top, right, bottom of each mask in pixels, right and bottom exclusive.
        areas: pixels of each mask.
        scores: predicted IoU of each mask.
        overlap: boxes with a larger IoU than this are of the same thing.
        prefer_large: among masks of the same extent that score about as well, keep the one with most pixels: a car
            rather than a car without its windows.
    """
    order = np.lexsort((np.arange(len(scores)), -areas, -scores))
    kept = []
    while len(order):
        best = order[0]
        iou = _compute_box_iou(boxes[best], boxes[order])
        chosen = best
        if prefer_large:
            same = order[(iou >= SAME_EXTENT) & (scores[order] >= scores[best] - SCORE_MARGIN)]
            chosen = same[np.argmax(areas[same])] if len(same) else best
        kept.append(chosen)
        order = order[(iou <= overlap) & (order != best)]
    return np.array(kept, np.int64)


def _compute_box_iou(box: Float32[ndarray, "4"], others: Float32[ndarray, "n 4"]) -> Float64[ndarray, " n"]:
    low, high = np.maximum(box[:2], others[:, :2]), np.minimum(box[2:], others[:, 2:])
    shared = np.prod(np.maximum(high - low, 0), axis=1, dtype=np.float64)
    area, areas = np.prod(box[2:] - box[:2], dtype=np.float64), np.prod(others[:, 2:] - others[:, :2], axis=1)
    return shared / np.maximum(area + areas - shared, 1e-9)


def clean_regions(regions: Regions, allowed: Bool[ndarray, "h w"], min_pixels: int) -> Regions:
    """Cut masks to the pixels allowed, without holes and islands below `min_pixels`.

    What lies for the most part where nothing is allowed, or becomes too small, is left out.
    """
    masks, kept = [], []
    for number, mask in enumerate(regions.masks):
        inside = mask & allowed
        if 2 * inside.sum() <= mask.sum():
            continue
        filled = ~_drop_specks(~inside, min_pixels) & allowed
        whole = _drop_specks(filled, min_pixels)
        if whole.any():
            masks.append(whole)
            kept.append(number)
    return Regions(np.array(masks, bool).reshape(-1, *allowed.shape), regions.scores[np.array(kept, np.int64)])


def _drop_specks(mask: Bool[ndarray, "h w"], min_pixels: int) -> Bool[ndarray, "h w"]:
    pieces = np.zeros(mask.shape, np.int32)
    ndimage.label(mask, output=pieces)
    sizes = np.bincount(pieces.ravel())
    large = sizes >= max(1, min_pixels)
    large[0] = False
    return large[pieces]


def merge_parts(regions: Regions, containment: float) -> Regions:
    """Merge parts into whole objects: each mask joins the largest whole that contains `containment` of it.

    Not every larger mask is a whole. One is none if it covers half of the photo, if the segmenter itself trusts it less
    than the part, or if it is a group: wholly covered by several masks, none of them its main part, which score higher.
    Groups are left out, as what they consist of is there already.
    """
    areas = regions.masks.sum(axis=(1, 2), dtype=np.int64)
    order = np.lexsort((np.arange(len(areas)), areas))  # from small to large
    regions, areas = regions.select(order), areas[order]
    inside = _count_shared_pixels(regions.masks) >= containment * areas[:, None]
    np.fill_diagonal(inside, False)
    inside &= np.arange(len(areas))[:, None] < np.arange(len(areas))  # in a larger one
    groups = _find_groups(regions, areas, inside)
    trusted = inside & ~groups & (areas <= LARGEST_WHOLE * np.prod(regions.masks.shape[1:]))
    trusted &= regions.scores >= regions.scores[:, None] - SCORE_MARGIN
    root = np.arange(len(areas))
    for part in range(len(areas) - 1, -1, -1):
        wholes = np.flatnonzero(trusted[part])
        if len(wholes) and not groups[part]:
            root[part] = root[wholes[-1]]
    roots = np.flatnonzero((root == np.arange(len(areas))) & ~groups)
    merged = [regions.masks[(root == one) & ~groups].any(axis=0) for one in roots]
    return Regions(np.array(merged, bool).reshape(-1, *regions.masks.shape[1:]), regions.scores[roots])


def _count_shared_pixels(masks: Bool[ndarray, "n h w"]) -> Float64[ndarray, "n n"]:
    """Count the pixels that each two masks have in common."""
    flat = masks.reshape(len(masks), masks.shape[1] * masks.shape[2])
    shared = np.zeros((len(masks), len(masks)))
    for start in range(0, flat.shape[1], BLOCK):
        block = flat[:, start : start + BLOCK].astype(np.float32)
        shared += block @ block.T
    return shared


def _find_groups(regions: Regions, areas: Int64[ndarray, " n"], inside: Bool[ndarray, "n n"]) -> Bool[ndarray, " n"]:
    """Find masks that are several objects in one; masks are sorted from small to large."""
    groups = np.zeros(len(areas), bool)
    for number in range(len(areas)):
        parts = np.flatnonzero(inside[:, number] & ~groups)
        parts = parts[~inside[np.ix_(parts, parts)].any(axis=1)]  # parts of parts say nothing new
        if len(parts) < 2 or areas[parts].max() > MAIN_SHARE * areas[number]:
            continue
        covered = (regions.masks[parts].any(axis=0) & regions.masks[number]).sum()
        score = np.average(regions.scores[parts], weights=areas[parts])
        groups[number] = covered >= GROUP_COVER * areas[number] and score > regions.scores[number]
    return groups


def paint_regions(regions: Regions, min_pixels: int) -> UInt32[ndarray, "h w"]:
    """Paint the position of a mask + 1 into each pixel, small masks over large ones; 0 = none.

    Pieces of which less than `min_pixels` stay visible go to nobody.
    """
    labels = np.zeros(regions.masks.shape[1:], np.uint32)
    areas = regions.masks.sum(axis=(1, 2), dtype=np.int64)
    for number in np.lexsort((np.arange(len(areas)), -areas)):
        labels[regions.masks[number]] = number + 1
    for label in range(1, len(areas) + 1):
        mine = labels == label
        labels[mine & ~_drop_specks(mine, min_pixels)] = 0
    return labels
