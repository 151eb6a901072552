"""The order in which splats are blended, sorted at once or on another thread.

Once it is known that a scene's orders are wanted again and again, the thread puts its splats into blocks, and later
orders leave out the blocks that a view cannot show.
"""

from __future__ import annotations

from collections.abc import Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from jaxtyping import Bool, Float32, UInt32
from numpy import ndarray

from instdrive_app.render.splat_blocks import SplatBlocks, SplatPlaces
from instdrive_app.render.view_cone import ViewCone
from instdrive_core.maths.sorting import sort_back_to_front
from instdrive_core.scene.camera import Camera


@dataclass(frozen=True)
class DepthOrder:
    """Rows in blending order for one viewing direction and one state of the scene."""

    key: Any
    """Identifies viewing direction, state and view."""
    rows: UInt32[ndarray, " n"]
    """Rows that may be seen, those in front of the camera first and farthest first; then the others, which a camera
    that has turned since may see."""
    in_view: int
    """Number of rows that may be seen by a camera inside `cone`."""
    depth_range: tuple[float, float]
    """Depths (metres) that hold the middle 94 % of the splats in front of the camera and in view."""
    cone: ViewCone | None = None
    """Where the rows in view are; None where all rows in front of the camera are, whatever the view."""

    def covers(self, camera: Camera) -> bool:
        """Whether a camera that looks along the axis, or nearly so, sees no other rows than those in view."""
        return self.cone is None or self.cone.covers(camera)


def sort_by_depth(
    key: Hashable,
    means: Float32[ndarray, "n 3"],
    axis: Float32[ndarray, "4"],
    near: float,
    cone: ViewCone | None = None,
    inside: Bool[ndarray, " n"] | None = None,
) -> DepthOrder:
    """Sort by depth = axis · (x, y, z, 1), metres; splats nearer than `near` count as behind the camera.

    Args:
        inside: Splats that reach into `cone`; only they are sorted.
    """
    depths = _measure_depths(means, axis)
    depth_range = _find_depth_range(depths, near)
    if inside is None:
        front = sort_back_to_front(depths, near)
        behind = np.flatnonzero(depths <= near).astype(np.uint32)
        return DepthOrder(key, np.concatenate([front, behind]), len(front), depth_range)
    seen = np.where(inside, depths, np.float32(np.nan))
    front, behind = sort_back_to_front(seen, near), np.flatnonzero(seen <= near)
    behind = behind[np.argsort(-seen[behind], kind="stable")]  # a camera that goes back may see them
    rows = np.concatenate([front, behind, np.flatnonzero(~inside)]).astype(np.uint32)
    return DepthOrder(key, rows, len(front) + len(behind), depth_range, cone)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _measure_depths(means, axis):
    """A row's depth has the same bits whatever rows it is measured with."""
    depths = np.empty(len(means), np.float32)
    for row in range(len(means)):
        depths[row] = axis[0] * means[row, 0] + axis[1] * means[row, 1] + axis[2] * means[row, 2] + axis[3]
    return depths


@dataclass(frozen=True)
class CulledView:
    """What an order may be cut to: the splats that reach into a cone."""

    cone: ViewCone
    places: SplatPlaces
    version: int
    """Rises when places change."""


_SAMPLE = 500_000
"""Splats that the range of depths is found from at most."""
NOTHING_SORTED = DepthOrder(None, np.zeros(0, np.uint32), 0, (1.0, 100.0))
"""The order before the first one: nothing is drawn."""


class OrderSorter:
    """Keeps the last order, and computes newer ones at once or in the background."""

    def __init__(self) -> None:
        self._thread: ThreadPoolExecutor | None = None
        self._running: tuple[Hashable, Future[DepthOrder]] | None = None
        self._latest = NOTHING_SORTED
        self._blocks: SplatBlocks | None = None
        self._building: Future[SplatBlocks] | None = None

    def sort_now(
        self,
        key: Hashable,
        means: Float32[ndarray, "n 3"],
        axis: Float32[ndarray, "4"],
        near: float,
        view: CulledView | None = None,
    ) -> DepthOrder:
        """Return the order for `key`, however long it takes."""
        running = self._running
        if running is not None and running[0] == key:
            self._latest, self._running = running[1].result(), None
        if self._latest.key != key:
            self._latest = _sort(self._find_blocks(means), key, means, axis, near, view)
        return self._latest

    def sort_soon(
        self,
        key: Hashable,
        means: Float32[ndarray, "n 3"],
        axis: Float32[ndarray, "4"],
        near: float,
        view: CulledView | None = None,
    ) -> DepthOrder:
        """Return the newest order there is, at once, and start sorting the one for `key`; call again until it is there.

        At most one sort runs at a time, so a moving camera gets orders as fast as they are sorted. Raises what a sort
        raised. Rows that move during a sort spoil its order, which is then out of date anyway.

        Args:
            view: What the order may be cut to.
        """
        if self._running is not None and self._running[1].done():
            self._latest, self._running = self._running[1].result(), None
        if self._running is None and self._latest.key != key:
            if self._thread is None:
                self._thread = ThreadPoolExecutor(max_workers=2, thread_name_prefix="splat-order")
            blocks = self._find_blocks(means)
            self._running = key, self._thread.submit(_sort, blocks, key, means, axis, near, view)
            if view is not None and blocks is None and self._building is None and self._latest is not NOTHING_SORTED:
                self._building = self._thread.submit(SplatBlocks, view.places)
        return self._latest

    def release(self) -> None:
        """End the threads."""
        if self._thread is not None:
            self._thread.shutdown(wait=True, cancel_futures=True)
        self._thread, self._running, self._latest = None, None, NOTHING_SORTED
        self._blocks = self._building = None

    def _find_blocks(self, means: Float32[ndarray, "n 3"]) -> SplatBlocks | None:
        """The scene's blocks, if they are there and it has as many splats as when they were built."""
        if self._building is not None and self._building.done():
            self._blocks, self._building = self._building.result(), None
        return self._blocks if self._blocks is not None and len(self._blocks) == len(means) else None


def _sort(
    blocks: SplatBlocks | None,
    key: Hashable,
    means: Float32[ndarray, "n 3"],
    axis: Float32[ndarray, "4"],
    near: float,
    view: CulledView | None,
) -> DepthOrder:
    if blocks is None or view is None:
        return sort_by_depth(key, means, axis, near)
    blocks.update(view.places, view.version)
    return sort_by_depth(key, means, axis, near, view.cone, blocks.find_inside(view.cone))


def _find_depth_range(depths: Float32[ndarray, " n"], near: float) -> tuple[float, float]:
    sample = depths[:: max(1, len(depths) // _SAMPLE)]
    sample = sample[(sample > near) & (sample < np.inf)]
    count = len(sample)
    if not count:
        return 1.0, 100.0
    places = max(count - 1 - int(0.97 * count), 0), count - 1 - int(0.03 * count)
    closest, farthest = np.partition(sample, places)[list(places)]
    return float(closest), float(max(farthest, closest * np.float32(1.01)))
