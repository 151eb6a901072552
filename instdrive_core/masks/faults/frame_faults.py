"""Faults put into perfect masks, so that a synthetic clip trains on what a segmenter would give it.

``sam-v1``: in each frame, 25 % of the objects fall into 2–4 compact parts, 10 % of the pairs of objects that touch
become one mask, 10 % of the objects are missed, and borders are ragged by up to 2 px. What happens depends on the seed,
the frame's key and its labels only.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64, Integer, UInt32
from numpy import ndarray

from instdrive_core.masks.faults.ragged_borders import draw_border_shifts, shift_labels
from instdrive_core.maths.streams import Stream, make_generator

_CANDIDATES = 4
"""Places tried for each part's centre; the one farthest from the centres before is taken: no part is a sliver."""


@dataclass(frozen=True)
class MaskFaults:
    """Rates at which faults occur."""

    split: float = 0.25
    """Share of objects that fall into parts."""
    most_parts: int = 4
    """Parts are 2 to this many, each as likely."""
    merged: float = 0.1
    """Share of the pairs of touching objects (of those not missed) that become one mask."""
    dropped: float = 0.1
    """Share of objects that are missed; none of them is split as well."""
    ragged: float = 2.0
    """Largest distance in pixels by which a border moves."""
    grain: int = 4
    """Pixels along a border after which it moves otherwise."""


def add_faults(
    instances: Integer[ndarray, "h w"], closed: Bool[ndarray, "h w"], faults: MaskFaults, key: str, seed: int
) -> UInt32[ndarray, "h w"]:
    """Put faults into a frame's masks, as a segmenter would have got them wrong.

    Args:
        instances: exact labels; 0 = none.
        closed: where no mask may grow into: sky, ego vehicle.
        faults: rates of the faults.
        key: key of the frame.
        seed: number that, with the key, chooses what goes wrong.

    Returns labels 1…n, each of one pixel at least; 0 = none.
    """
    rng = make_generator(seed, Stream.MASK_FAULTS, zlib.crc32(key.encode()))
    order = np.unique(instances, return_inverse=True)[1].reshape(instances.shape)
    objects = _renumber((order + 1) * (instances > 0))
    fate = rng.random(int(objects.max(initial=0)) + 1)
    is_kept = fate >= faults.dropped
    is_kept[0] = False
    objects = np.where(is_kept[objects], objects, 0)
    is_split = is_kept & (fate < faults.dropped + faults.split)
    parts = _split_objects(objects, is_split, faults.most_parts, rng)
    masks = _merge_objects(parts, objects, faults.merged, rng)
    return _roughen_borders(masks, closed, faults, rng).astype(np.uint32)


def _split_objects(
    objects: Int64[ndarray, "h w"], is_split: Bool[ndarray, " o"], most_parts: int, rng: np.random.Generator
) -> Int64[ndarray, "h w"]:
    """Number parts by `most_parts` · object + part. A part is what lies nearest to one of the object's centres."""
    parts = objects * most_parts
    chosen = np.flatnonzero(is_split[objects])
    members = objects.ravel()[chosen]
    order = np.argsort(members, kind="stable")
    for pixels in np.split(chosen[order], np.flatnonzero(np.diff(members[order])) + 1):
        count = min(int(rng.integers(2, most_parts + 1)), len(pixels))
        places = np.stack(np.divmod(pixels, objects.shape[1]), axis=1).astype(np.float64)
        if count > 1:
            parts.ravel()[pixels] += _assign_to_centers(places, count, rng)
    return parts


def _assign_to_centers(places: Float64[ndarray, "n 2"], count: int, rng: np.random.Generator) -> Int64[ndarray, " n"]:
    """Assign each place to the nearest of `count` centres, spread over the places at random. Every centre is a place of
    its own, so that none goes without."""
    distances = np.empty((count, len(places)))
    nearest = np.full(len(places), np.inf)
    for part in range(count):
        tried = rng.integers(0, len(places), _CANDIDATES if part else 1)
        center = int(tried[np.argmax(nearest[tried])])
        if nearest[center] == 0:  # candidates of a tiny object were all taken
            center = int(np.argmax(nearest))
        distances[part] = ((places - places[center]) ** 2).sum(axis=1)
        nearest = np.minimum(nearest, distances[part])
    return np.argmin(distances, axis=0)


def _merge_objects(
    parts: Int64[ndarray, "h w"], objects: Int64[ndarray, "h w"], share: float, rng: np.random.Generator
) -> Int64[ndarray, "h w"]:
    """Join some parts of different objects to masks 1…n: those with the pair's longest common border."""
    masks = _renumber(parts)
    owner = np.zeros(masks.max(initial=0) + 1, np.int64)
    owner[masks.ravel()] = objects.ravel()
    pairs, lengths = _find_touching_pairs(masks, owner)
    owners = np.sort(owner[pairs], axis=1)
    longest_first = np.lexsort((-lengths, owners[:, 1], owners[:, 0]))
    _, first = np.unique(owners[longest_first], axis=0, return_index=True)
    joint = pairs[longest_first[first]]
    root = np.arange(len(owner))
    wanted = int(share * len(joint) + rng.random())  # the share on average, also of a few pairs
    for one, other in rng.permutation(joint):
        if np.count_nonzero(root[joint[:, 0]] == root[joint[:, 1]]) >= wanted:  # chains merge pairs of their own
            break
        root[root == root[other]] = root[one]
    return _renumber(root[masks])


def _find_touching_pairs(
    masks: Int64[ndarray, "h w"], owner: Int64[ndarray, " m"]
) -> tuple[Int64[ndarray, "p 2"], Int64[ndarray, " p"]]:
    """Find pairs of masks of different objects that share pixel edges, and how many; smaller number first."""
    border = np.concatenate([_select_unequal(masks[:, :-1], masks[:, 1:]), _select_unequal(masks[:-1], masks[1:])])
    border = np.sort(border[(border > 0).all(axis=1)], axis=1)
    codes, lengths = np.unique(border[:, 0] * len(owner) + border[:, 1], return_counts=True)
    pairs = np.stack(np.divmod(codes, len(owner)), axis=1)
    different = owner[pairs[:, 0]] != owner[pairs[:, 1]]
    return pairs[different], lengths[different]


def _select_unequal(ones: Int64[ndarray, "h w"], others: Int64[ndarray, "h w"]) -> Int64[ndarray, "n 2"]:
    """Select the pairs that differ."""
    differ = ones != others
    return np.stack([ones[differ], others[differ]], axis=1)


def _roughen_borders(
    masks: Int64[ndarray, "h w"], closed: Bool[ndarray, "h w"], faults: MaskFaults, rng: np.random.Generator
) -> Int64[ndarray, "h w"]:
    """Move the borders of masks: each pixel takes the label of a place up to `ragged` px away."""
    moved = shift_labels(masks, draw_border_shifts(*masks.shape, faults.ragged, faults.grain, rng))
    moved[closed] = masks[closed]
    anchors = np.zeros(masks.max(initial=0) + 1, np.int64)
    anchors[masks.ravel()] = np.arange(masks.size)
    while len(lost := np.flatnonzero(np.bincount(moved.ravel(), minlength=len(anchors))[1:] == 0) + 1):
        moved.ravel()[anchors[lost]] = lost  # a mask of a few pixels keeps one of them
    return moved


def _renumber(labels: Int64[ndarray, "h w"]) -> Int64[ndarray, "h w"]:
    """Renumber small labels to 1…n in their order; 0 stays."""
    is_present = np.bincount(labels.ravel()) > 0
    is_present[:1] = False
    return (np.cumsum(is_present) * is_present)[labels]
