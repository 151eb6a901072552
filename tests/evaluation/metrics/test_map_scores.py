"""Per-view and scene-level figures differ exactly where an object changes its ID."""

import numpy as np
import pytest

from instdrive_core.evaluation.metrics.map_scores import score_scene, score_views
from instdrive_core.evaluation.metrics.segmentation import LabelledView


def view(camera: str, time: float, truth: list[int], predicted: list[int]) -> LabelledView:
    """A map of one row in which every entry stands for 10 pixels."""
    return LabelledView(camera, time, *(np.repeat(np.array([m], np.uint32), 10, axis=1) for m in (truth, predicted)))


@pytest.fixture
def views() -> list[LabelledView]:
    # Instance 2 changes its ID from 6 to 7 in the second view: perfect in each view, not in the scene.
    return [view("front", 0.0, [1, 1, 2, 0], [5, 5, 6, 6]), view("front", 0.1, [1, 1, 2, 0], [5, 5, 7, 5])]


def test_per_view_does_not_see_changed_ids(views):
    assert score_views(views) == {"miou": 1, "macc": 1, "miou_majority": 1}


def test_scene_does(views):
    scores = score_scene(views, things=[2], stuff=[1])
    assert scores["miou_stuff"] == 1
    assert scores["miou_things"] == 0.5
    assert scores["miou"] == scores["macc"] == 0.75
    assert scores["acc25"] == 1
    assert scores["acc50"] == 0.5
    assert scores["id_switches"] == 1
    # Stuff is found. The thing's two IDs are two false positives, unless half of their pixels are ignored ones.
    assert scores["pq"] == pytest.approx(1 / (1 + 2 / 2 + 1 / 2))


def test_views_without_labels_are_left_out_of_means(views):
    assert score_views([*views, view("back", 0.0, [0, 0, 0, 0], [1, 1, 1, 1])])["miou"] == 1


def test_no_labels_at_all_gives_none_everywhere():
    unlabelled = [view("front", 0.0, [0, 0], [1, 2])]
    assert set(score_views(unlabelled).values()) == {None}
    assert set(score_scene(unlabelled, [1], [2]).values()) == {None}
    assert score_scene([view("front", 0.0, [1], [1])], [1], [])["miou_stuff"] is None
