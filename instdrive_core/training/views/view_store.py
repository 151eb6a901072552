"""The training photos of a clip: read when asked for, kept within a budget of memory, read ahead by hints."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError
from instdrive_core.masks.label_map_folder import SIDECAR, MaskFolder
from instdrive_core.scene.camera import Camera
from instdrive_core.training.views.lidar_depth import Depths, load_frame_depths
from instdrive_core.training.views.photo_budget import BYTES_PER_PIXEL, choose_photo_budget, count_readers
from instdrive_core.training.views.training_view import TrainingView, build_training_view

DEFAULT_BUDGET = 2**30
"""Bytes of photos and masks kept in memory where nobody has chosen others."""
_READ_AHEAD = 16
"""Hints that are looked at: more would be read long before their turn."""
_PATIENCE = 10.0
"""Seconds that closing waits for a photo being read."""

Key = tuple[int, bool]
"""Number of a view, and whether at half the resolution."""


@dataclass(frozen=True)
class ViewFacts:
    """Facts of a view that need no look at its photo."""

    key: str
    """``camera/NN``."""
    camera: Camera
    """At full training resolution."""
    time: float
    """Seconds since the clip's first time step."""
    has_masks: bool
    """Whether instances are marked in it (some may lie on the ego car, where they do not count)."""

    @property
    def step(self) -> int:
        """Time step of the clip."""
        return int(self.key.rsplit("/", 1)[1])


class ViewStore:
    """Training views by number; may be asked from several threads at once.

    What it returns depends neither on the budget nor on hints. Photos and masks least recently asked for leave memory
    first; a view in use elsewhere and what `read` itself holds (LiDAR depths) are not counted.

    Args:
        facts: of all views.
        read: reads the view of a number at full training resolution; from several threads at once.
        budget_bytes: of views kept in memory, half-resolution versions included. A view that exceeds it alone is read
            each time; for reading ahead it should hold several.
        readers: most threads that read ahead at once.
    """

    def __init__(
        self,
        facts: Sequence[ViewFacts],
        read: Callable[[int], TrainingView],
        budget_bytes: int = DEFAULT_BUDGET,
        readers: int = 1,
    ) -> None:
        self.facts = tuple(facts)
        self._read, self._budget, self._readers = read, budget_bytes, readers
        self._kept: OrderedDict[Key, tuple[TrainingView, int]] = OrderedDict()
        """Views and their bytes, those asked for last at the end."""
        self._kept_bytes = 0
        self._reading: set[Key] = set()
        self._failed: dict[Key, Exception] = {}
        """Errors met while reading ahead, until the view is asked for."""
        self._wanted: deque[Key] = deque()
        self._workers: set[threading.Thread] = set()
        self._closed = False
        self._poses: tuple[Float64[ndarray, "4 4"], ...] | None = None
        """world_from_camera of each view where it was corrected."""
        self._changed = threading.Condition()
        """Guards everything above; told whenever a view has been read."""

    @staticmethod
    def from_views(views: Sequence[TrainingView], budget_bytes: int = DEFAULT_BUDGET) -> ViewStore:
        """Make a store of views that are in memory already."""
        facts = [
            ViewFacts(view.key, view.camera, view.time, view.labels is not None and bool(view.labels.any()))
            for view in views
        ]
        return ViewStore(facts, tuple(views).__getitem__, budget_bytes)

    def __len__(self) -> int:
        return len(self.facts)

    def __enter__(self) -> ViewStore:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def times(self) -> tuple[float, ...]:
        """Seconds of each view."""
        return tuple(photo.time for photo in self.facts)

    @property
    def kept_bytes(self) -> int:
        """Bytes of views in memory now; never more than the budget."""
        return self._kept_bytes

    def place_cameras(self, poses: Sequence[Float64[ndarray, "4 4"]] | None) -> None:
        """From now on, return views with corrected cameras: world_from_camera of each view; None = as they were."""
        self._poses = None if poses is None else tuple(poses)

    def get(self, number: int, coarse: bool = False) -> TrainingView:
        """Get a view, at half the resolution with `coarse`. Do not write into its arrays.

        Raises DataError where its photo or a mask is missing or damaged, IndexError where there is no such view.
        """
        if not 0 <= number < len(self):
            raise IndexError(f"view {number} of {len(self)}")
        view = self._find_view((number, coarse))
        if self._poses is None:
            return view
        return replace(view, camera=replace(view.camera, world_from_camera=self._poses[number]))

    def _find_view(self, key: Key) -> TrainingView:
        with self._changed:
            self._changed.wait_for(lambda: key not in self._reading)
            failure = self._failed.pop(key, None)
            if failure is not None:
                raise failure
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key][0]
            self._reading.add(key)
        try:
            return self._read_and_keep(key)
        finally:
            self._finish(key)

    def prefetch(self, views: Sequence[Key]) -> None:
        """Hint which views will be asked for next, soonest first; replaces earlier hints. Returns at once.

        Threads read ahead as far as half the budget goes; an error that they meet is raised when the view is asked
        for.
        """
        with self._changed:
            if self._closed:
                return
            self._wanted = deque(self._missing(views))
            for _ in range(min(self._readers - len(self._workers), len(self._wanted))):
                worker = threading.Thread(target=self._read_ahead, name="read training photos", daemon=True)
                self._workers.add(worker)
                worker.start()

    def close(self) -> None:
        """Stop reading ahead and forget all views; what is asked for later is read anew."""
        with self._changed:
            self._closed = True
            self._wanted.clear()
            workers = tuple(self._workers)
        deadline = time.monotonic() + _PATIENCE
        for worker in workers:
            worker.join(max(deadline - time.monotonic(), 0))
        self.release()

    def release(self) -> None:
        """Give the memory of all views back; they are read anew when asked for."""
        with self._changed:
            self._kept.clear()
            self._kept_bytes = 0

    def _read_ahead(self) -> None:
        """What each worker does: ends when nothing is wanted any more, so that no thread outlives its use."""
        while (key := self._take_next_wanted()) is not None:
            try:
                self._read_and_keep(key)
            except Exception as error:  # raised where the view is asked for
                with self._changed:
                    self._failed[key] = error
            finally:
                self._finish(key)

    def _take_next_wanted(self) -> Key | None:
        """The next view for this worker, entered into `_reading`; None ends the worker."""
        with self._changed:
            while self._wanted:
                key = self._wanted.popleft()
                if not self._is_settled(key):
                    self._reading.add(key)
                    return key
            self._workers.discard(threading.current_thread())
            return None

    def _read_and_keep(self, key: Key) -> TrainingView:
        number, coarse = key
        with self._changed:
            kept = self._kept.get((number, False))
        full = self._read(number) if kept is None else kept[0]
        view = full.halve() if coarse else full
        with self._changed:
            if coarse and self._kept_bytes + _count_bytes(full, False) <= self._budget // 2:
                self._keep((number, False), full)  # spares reading it again, but must not cost other views their place
            self._keep(key, view)
        return view

    def _finish(self, key: Key) -> None:
        with self._changed:
            self._reading.discard(key)
            self._changed.notify_all()

    # With the lock held:

    def _keep(self, key: Key, view: TrainingView) -> None:
        size = _count_bytes(view, key[1])
        if size > self._budget or key in self._kept or self._closed:
            return
        while self._kept_bytes + size > self._budget:
            _, (_, freed) = self._kept.popitem(last=False)
            self._kept_bytes -= freed
        self._kept[key] = view, size
        self._kept_bytes += size

    def _missing(self, views: Sequence[Key]) -> list[Key]:
        """The hinted views still to be read, as far as half the budget goes."""
        hinted: list[Key] = []
        room = self._budget // 2
        for key in dict.fromkeys(views[:_READ_AHEAD]):
            camera = self.facts[key[0]].camera
            room -= camera.width * camera.height * BYTES_PER_PIXEL // (4 if key[1] else 1)
            if room < 0:
                break
            hinted.append(key)
        for key in reversed(hinted):  # the soonest leaves last
            if key in self._kept:
                self._kept.move_to_end(key)
        return [key for key in hinted if not self._is_settled(key)]

    def _is_settled(self, key: Key) -> bool:
        return key in self._kept or key in self._reading or key in self._failed


def open_view_store(
    clip: Clip,
    masks: MaskFolder | None,
    budget_bytes: int | None = None,
    photo_depths: Sequence[Depths] | None = None,
) -> ViewStore:
    """Open the training photos of a clip with the LiDAR depth of their time steps and their masks.

    They are kept within `budget_bytes`; None = as much as `choose_photo_budget` finds the memory good for.
    `photo_depths` are those of a clip without LiDAR, one for each training photo, as photos agree on them.

    LiDAR is read here, from sweeps that may train, and its depths stay in memory (some 0.1 MB per photo); photos and
    masks are read when asked for.

    Raises DataError where a sweep is damaged or the masks lack a photo.
    """
    frames = clip.training_frames
    if masks is not None:
        _check_masks(masks, frames)
    depths = load_frame_depths(clip, frames) if photo_depths is None else photo_depths

    def read(number: int) -> TrainingView:
        frame = frames[number]
        return build_training_view(frame, masks.load(frame) if masks else None, depths[number], photo_depths is None)

    facts = [
        ViewFacts(frame.key, frame.view.camera, frame.view.time, masks is not None and masks.counts[frame.key] > 0)
        for frame in frames
    ]
    if budget_bytes is None:
        budget_bytes = choose_photo_budget([photo.camera.width * photo.camera.height for photo in facts])
    return ViewStore(facts, read, budget_bytes, count_readers())


def _check_masks(masks: MaskFolder, frames: Sequence[Frame]) -> None:
    """Check that no photo lacks its masks: they are read late, but the user should know before training starts."""
    missing = [frame.key for frame in frames if frame.key not in masks.counts]
    if missing:
        problem = f"{len(missing)} of {len(frames)} training photos have no masks, e.g. '{missing[0]}'"
        raise DataError(masks.path / SIDECAR, problem, "Write the masks again with `instdrive masks`")


def _count_bytes(view: TrainingView, coarse: bool) -> int:
    """Count the bytes of a view's own arrays. At full resolution, depths and `valid` are held elsewhere anyway."""
    arrays = [view.image, *view.layers, view.sky, view.sky]  # `solid` is made when it is asked for, and as large
    if coarse:
        arrays += [view.valid, view.depth_pixels, view.depth_values]
    return sum(array.nbytes for array in arrays if array is not None)
