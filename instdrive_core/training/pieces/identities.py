"""Instances of two pieces that are the same thing: both scenes are looked at from the photos that the pieces share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64, UInt32
from numpy import ndarray

from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.rasterize.sky_evidence import choose_spread_views
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene

MOST_VIEWS = 60
"""Photos of a border that are looked at …"""
WIDTH = 240
"""… at so many pixels across."""
LEAST_OVERLAP = 0.25
"""IoU over all pixels looked at from which on two instances may be one."""
LEAST_PIXELS = 30
"""Pixels that both must share."""


@dataclass(frozen=True)
class SharedPixels:
    """Pixels of an instance of one piece and of one of the next, in the pictures of a border."""

    first: Int64[ndarray, " k"]
    second: Int64[ndarray, " k"]
    pixels: Int64[ndarray, " k"]


def count_shared_pixels(first: Scene, second: Scene, views: Sequence[CameraView]) -> SharedPixels:
    """Count the pixels that both scenes give an instance, by pair of IDs; moving objects are left out.

    `views` are photos that both were trained on; of many, some are looked at.
    """
    counts: dict[tuple[int, int], int] = {}
    for view in choose_spread_views(views, MOST_VIEWS):
        maps = [_draw_static_ids(scene, view) for scene in (first, second)]
        both = (maps[0] > 0) & (maps[1] > 0)
        pairs = np.stack([maps[0][both], maps[1][both]]).astype(np.int64)
        found, pixels = np.unique(pairs, axis=1, return_counts=True)
        for one, other, count in zip(*found.tolist(), pixels.tolist(), strict=True):
            counts[one, other] = counts.get((one, other), 0) + count
    table = np.array([(*pair, count) for pair, count in sorted(counts.items())], np.int64).reshape(-1, 3)
    return SharedPixels(table[:, 0], table[:, 1], table[:, 2])


def match_instances(shared: SharedPixels) -> list[tuple[int, int]]:
    """Match the pairs of IDs each of which has no better partner than the other, by the IoU of their pixels."""
    if not len(shared.pixels):
        return []
    (ones, first), (others, second) = (np.unique(ids, return_inverse=True) for ids in (shared.first, shared.second))
    areas = np.bincount(first, shared.pixels)[first] + np.bincount(second, shared.pixels)[second]
    overlaps = shared.pixels / (areas - shared.pixels)
    best_first, best_second = np.zeros(len(ones)), np.zeros(len(others))
    np.maximum.at(best_first, first, overlaps)
    np.maximum.at(best_second, second, overlaps)
    mutual = (overlaps >= best_first[first]) & (overlaps >= best_second[second])
    chosen = mutual & (overlaps >= LEAST_OVERLAP) & (shared.pixels >= LEAST_PIXELS)
    pairs: list[tuple[int, int]] = []
    for row in np.flatnonzero(chosen).tolist():  # of equals the first
        pair = int(shared.first[row]), int(shared.second[row])
        if not any(pair[0] == one or pair[1] == other for one, other in pairs):
            pairs.append(pair)
    return pairs


class InstanceUnion:
    """Instances of all pieces, and which of them are one: the pairs that were joined, and what follows from them."""

    def __init__(self) -> None:
        self._parents: dict[tuple[int, int], tuple[int, int]] = {}

    def find(self, instance: tuple[int, int]) -> tuple[int, int]:
        """Find the one that stands for an instance (piece, ID): the lowest of all that are joined with it."""
        root = instance
        while self._parents.get(root, root) != root:
            root = self._parents[root]
        return root

    def join(self, instances: Iterable[tuple[int, int]]) -> None:
        """Join instances into one."""
        roots = sorted({self.find(instance) for instance in instances})
        for root in roots[1:]:
            self._parents[root] = roots[0]


def _draw_static_ids(scene: Scene, view: CameraView) -> UInt32[ndarray, "h w"]:
    camera = view.camera.scale(min(1.0, WIDTH / view.camera.width))
    ids = build_instance_map(scene, view_scene(scene, camera, view.time))
    moving = np.unique(scene.instance_ids[scene.nodes > 0])
    return np.where(np.isin(ids, moving), np.uint32(0), ids)
