"""The order in which splats are blended, sorted at once or on another thread."""

from __future__ import annotations

from collections.abc import Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt32
from numpy import ndarray

from instdrive_core.maths.sorting import sort_back_to_front


@dataclass(frozen=True)
class DepthOrder:
    """Rows in blending order for one viewing direction and one state of the scene."""

    key: Hashable
    """Identifies viewing direction and state."""
    rows: UInt32[ndarray, " n"]
    """Rows in front of the camera, farthest first; then those behind it, which a camera that has turned since may
    see."""
    in_front: int
    """Number of rows in front of the camera."""
    depth_range: tuple[float, float]
    """Depths (metres) that hold the middle 94 % of the splats in front of the camera."""


def sort_by_depth(
    key: Hashable, means: Float32[ndarray, "n 3"], axis: Float32[ndarray, "4"], near: float
) -> DepthOrder:
    """Sort by depth = axis · (x, y, z, 1), metres; splats nearer than `near` count as behind the camera."""
    depths = means @ axis[:3] + axis[3]
    front = sort_back_to_front(depths, near)
    behind = np.flatnonzero(depths <= near).astype(np.uint32)
    return DepthOrder(key, np.concatenate([front, behind]), len(front), _find_depth_range(depths, front))


NOTHING_SORTED = DepthOrder(None, np.zeros(0, np.uint32), 0, (1.0, 100.0))
"""The order before the first one: nothing is drawn."""


class OrderSorter:
    """Keeps the last order, and computes newer ones at once or in the background."""

    def __init__(self) -> None:
        self._thread: ThreadPoolExecutor | None = None
        self._running: tuple[Hashable, Future[DepthOrder]] | None = None
        self._latest = NOTHING_SORTED

    def sort_now(
        self, key: Hashable, means: Float32[ndarray, "n 3"], axis: Float32[ndarray, "4"], near: float
    ) -> DepthOrder:
        """Return the order for `key`, however long it takes."""
        running = self._running
        if running is not None and running[0] == key:
            self._latest, self._running = running[1].result(), None
        if self._latest.key != key:
            self._latest = sort_by_depth(key, means, axis, near)
        return self._latest

    def sort_soon(
        self, key: Hashable, means: Float32[ndarray, "n 3"], axis: Float32[ndarray, "4"], near: float
    ) -> DepthOrder:
        """Return the newest order there is, at once, and start sorting the one for `key`; call again until it is there.

        At most one sort runs at a time, so a moving camera gets orders as fast as they are sorted. Raises what a sort
        raised. Rows that move during a sort spoil its order, which is then out of date anyway.
        """
        if self._running is not None and self._running[1].done():
            self._latest, self._running = self._running[1].result(), None
        if self._running is None and self._latest.key != key:
            if self._thread is None:
                self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="splat-order")
            self._running = key, self._thread.submit(sort_by_depth, key, means, axis, near)
        return self._latest

    def release(self) -> None:
        """End the thread."""
        if self._thread is not None:
            self._thread.shutdown(wait=True, cancel_futures=True)
        self._thread, self._running, self._latest = None, None, NOTHING_SORTED


def _find_depth_range(depths: Float32[ndarray, " n"], front: UInt32[ndarray, " m"]) -> tuple[float, float]:
    count = len(front)
    if not count:
        return 1.0, 100.0
    far, near = depths[front[int(0.03 * count)]], depths[front[min(int(0.97 * count), count - 1)]]
    return float(near), float(max(far, near * np.float32(1.01)))
