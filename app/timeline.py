"""The time steps of a drive, and the dataset camera views nearest to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.track import Track


class Timeline:
    """Time steps (seconds, rising) of the views, or of the tracks where there are no views.

    Cameras that are not triggered together share a step by their index. With a step per photo, stepping would come
    back to the same photo of the camera in use and never leave it.
    """

    def __init__(self, views: Sequence[CameraView], actors: Sequence[Track] = ()) -> None:
        self._views = views
        times = _find_step_times(views) or {float(time) for actor in actors for time in actor.times}
        self.steps: tuple[float, ...] = tuple(sorted(times))
        self.camera_names: tuple[str, ...] = tuple(dict.fromkeys(view.name for view in views))

    @property
    def start(self) -> float:
        """Time of the first step; 0 without steps."""
        return self.steps[0] if self.steps else 0.0

    @property
    def end(self) -> float:
        """Time of the last step; 0 without steps."""
        return self.steps[-1] if self.steps else 0.0

    def find_step(self, time: float) -> int:
        """Find the index of the step nearest to `time`."""
        return int(np.argmin(np.abs(np.array(self.steps) - time))) if self.steps else 0

    def step_time(self, time: float, count: int) -> float:
        """Find the time `count` steps later, from the end back to the start."""
        return self.steps[(self.find_step(time) + count) % len(self.steps)]

    def find_nearest_view(self, name: str, time: float) -> int:
        """Find the index of camera `name`'s view nearest in time. Raises ValueError for an unknown name."""
        candidates = [(abs(view.time - time), index) for index, view in enumerate(self._views) if view.name == name]
        if not candidates:
            raise ValueError(f"the scene has no camera {name!r}; it has {', '.join(self.camera_names) or 'none'}")
        return min(candidates)[1]


def _find_step_times(views: Sequence[CameraView]) -> set[float]:
    """Find the median time of each step's photos."""
    of_step: dict[int, list[float]] = {}
    for view in views:
        of_step.setdefault(view.index, []).append(view.time)
    return {sorted(times)[len(times) // 2] for times in of_step.values()}
