"""Clicks select what the map shows under them; shares are counted in clicks."""

import numpy as np
import pytest

from instdrive_core.evaluation.metrics.clicks import CLICKS_PER_OBJECT, Clicks, click_things, score_selections
from instdrive_core.evaluation.metrics.segmentation import LabelledView


def view(truth: np.ndarray, predicted: np.ndarray) -> LabelledView:
    return LabelledView("front", 0.0, truth.astype(np.uint32), predicted.astype(np.uint32))


@pytest.fixture
def halves() -> LabelledView:
    """Thing 1 is shown as 5; thing 2 half as 6, half as nothing; 3 is stuff; 0 is ignored."""
    truth = np.repeat([[1, 1, 2, 2, 3, 0]], 20, axis=0)
    predicted = np.repeat([[5, 5, 6, 0, 5, 6]], 20, axis=0)
    return view(truth, predicted)


def test_clicks_by_what_they_select(halves):
    clicks = click_things([halves], {1, 2}, seed=0)
    assert {(each.truth_id, each.selected): each.iou for each in clicks} == {
        (1, 5): pytest.approx(2 / 3),  # 5 also covers stuff
        (2, 0): 0.0,
        (2, 6): 0.5,  # its ignored column does not count
    }
    assert sum(each.count for each in clicks) == 2 * CLICKS_PER_OBJECT


def test_same_seed_same_clicks(halves):
    assert click_things([halves], {1, 2}, seed=1) == click_things([halves], {1, 2}, seed=1)
    different = {tuple(click_things([halves], {1, 2}, seed=seed)) for seed in range(8)}
    assert len(different) > 1


def test_scores_weigh_by_clicks():
    clicks = [Clicks(0, 1, 5, 6, 0.9), Clicks(0, 1, 0, 4, 0.0), Clicks(1, 2, 6, 10, 0.5)]
    assert score_selections(clicks) == {"hit_rate": 0.3, "iou": pytest.approx((6 * 0.9 + 10 * 0.5) / 20)}


def test_nothing_to_click_is_none():
    assert score_selections([]) == {"hit_rate": None, "iou": None}


def test_perfect_map_and_one_id_for_all():
    truth = np.repeat(np.arange(1, 11), 40).reshape(20, 20)
    assert score_selections(click_things([view(truth, truth)], range(1, 11), 0)) == {"hit_rate": 1, "iou": 1}
    one_id = score_selections(click_things([view(truth, np.ones_like(truth))], range(1, 11), 0))
    assert one_id == {"hit_rate": 0, "iou": pytest.approx(0.1)}
