"""The moments of a drive, and which dataset camera saw them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.track import Track


class Timeline:
    """Time steps (seconds, rising) of the views; of the tracks where there are no views.

    Cameras that are not triggered together share a step by their index: a step per photo would come back to the same
    photo of the camera that is looked through, and never leave it.
    """

    def __init__(self, views: Sequence[CameraView], actors: Sequence[Track] = ()) -> None:
        self._views = views
        times = _find_step_times(views) or {float(time) for actor in actors for time in actor.times}
        self.steps: tuple[float, ...] = tuple(sorted(times))
        self.camera_names: tuple[str, ...] = tuple(dict.fromkeys(view.name for view in views))

    @property
    def start(self) -> float:
        """The first moment; 0 where there is none."""
        return self.steps[0] if self.steps else 0.0

    @property
    def end(self) -> float:
        """The last moment."""
        return self.steps[-1] if self.steps else 0.0

    def find_step(self, time: float) -> int:
        """The number of the step nearest to `time`."""
        return int(np.argmin(np.abs(np.array(self.steps) - time))) if self.steps else 0

    def step_time(self, time: float, count: int) -> float:
        """The moment `count` steps on, around the ends."""
        return self.steps[(self.find_step(time) + count) % len(self.steps)]

    def find_nearest_view(self, name: str, time: float) -> int:
        """Index of the view of camera `name` nearest in time. Raises ValueError for an unknown name."""
        candidates = [(abs(view.time - time), index) for index, view in enumerate(self._views) if view.name == name]
        if not candidates:
            raise ValueError(f"the scene has no camera {name!r}; it has {', '.join(self.camera_names) or 'none'}")
        return min(candidates)[1]


def _find_step_times(views: Sequence[CameraView]) -> set[float]:
    """The middle one of the times of each step's photos."""
    of_step: dict[int, list[float]] = {}
    for view in views:
        of_step.setdefault(view.index, []).append(view.time)
    return {sorted(times)[len(times) // 2] for times in of_step.values()}
