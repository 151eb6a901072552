"""How the benchmark of long drives counts IDs that change at a border."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from benchmarks.long_drive import count_border_switches, count_crossing_objects
from instdrive_core.evaluation.metrics.segmentation import LabelledView

CAR, ROAD = 5, 8
BORDERS = (10,)


@dataclass(frozen=True)
class Shown:
    """A held-out view of two objects, each made of one Gaussian, some of which may be hidden."""

    step: int
    hidden: tuple[int, ...] = ()

    @property
    def frame(self):
        return SimpleNamespace(view=SimpleNamespace(index=self.step))

    @property
    def winner(self):
        return np.repeat(np.arange(2, dtype=np.int32) + 2 * (self.step >= BORDERS[0]), 50).reshape(10, 10)

    def with_ids(self, ids):
        truth = np.repeat(np.array([CAR, ROAD], np.uint32), 50).reshape(10, 10)
        truth = np.where(np.isin(truth, self.hidden), 0, truth).astype(np.uint32)
        return LabelledView("front", 0.1 * self.step, truth, ids[self.winner])


def test_an_object_that_changes_its_id_at_a_border_counts_once():
    views = [Shown(4), Shown(6), Shown(14), Shown(16)]
    assert count_border_switches(np.array([1, 2, 1, 2], np.uint32), views, BORDERS) == 0
    assert count_border_switches(np.array([1, 2, 3, 2], np.uint32), views, BORDERS) == 1
    assert count_border_switches(np.array([1, 2, 2, 1], np.uint32), views, BORDERS) == 2
    assert count_crossing_objects(views, BORDERS) == 2


def test_what_is_on_one_side_only_cannot_change():
    views = [Shown(4), Shown(14, hidden=(CAR,))]
    assert count_border_switches(np.array([1, 2, 3, 2], np.uint32), views, BORDERS) == 0
    assert count_crossing_objects(views, BORDERS) == 1
    assert count_border_switches(np.array([1, 2, 3, 4], np.uint32), views, ()) == 0
