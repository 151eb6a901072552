"""Segmentation figures on cases small enough to work out by hand, and on trivial controls."""

import numpy as np
import pytest

from instdrive_core.evaluation.metrics.segmentation import (
    LabelledView,
    count_confusion,
    count_id_switches,
    match_by_majority,
    match_one_to_one,
    panoptic_quality,
    prepare_truth,
)


def labels(*runs: tuple[int, int]) -> np.ndarray:
    """A label array from (ID, length) runs."""
    return np.concatenate([np.full(length, label, np.uint32) for label, length in runs])


def test_confusion_counts_shared_unpredicted_and_ignored_pixels():
    pixels = count_confusion(labels((5, 6), (9, 4), (0, 3)), labels((2, 4), (0, 2), (3, 4), (3, 2), (2, 1)))
    assert pixels.truth_ids.tolist() == [5, 9]
    assert pixels.predicted_ids.tolist() == [2, 3]
    assert pixels.shared.tolist() == [[4, 0], [0, 4]]
    assert pixels.truth_areas.tolist() == [6, 4]
    assert pixels.predicted_areas.tolist() == [4, 4]
    assert pixels.ignored_areas.tolist() == [1, 2]
    assert pixels.iou.tolist() == [[4 / 6, 0], [0, 1]]


def test_one_to_one_gives_each_prediction_to_one_instance_only():
    # One ID covers both instances: the larger one takes it, the other gets nothing.
    matched = match_one_to_one(count_confusion(labels((1, 6), (2, 4)), labels((7, 10))))
    assert matched.iou.tolist() == [0.6, 0]
    assert matched.recall.tolist() == [1, 0]
    assert matched.mean_iou() == pytest.approx(0.3)
    assert matched.mean_recall() == pytest.approx(0.5)
    assert matched.accuracy(0.5) == 0.5
    assert matched.accuracy(0.6) == 0, "the threshold itself is not enough"
    assert matched.mean_iou(among=[2]) == 0
    assert matched.mean_iou(among=[3]) is None


def test_one_to_one_maximises_the_sum_not_the_first_choice():
    # Instance 1 prefers ID 7 (IoU 6/13 over 4/10), but only ID 7 can serve instance 2.
    matched = match_one_to_one(count_confusion(labels((1, 10), (2, 3)), labels((8, 4), (7, 6), (7, 3))))
    assert matched.iou.tolist() == [4 / 10, 3 / 9]


def test_majority_rewards_fragments_and_one_to_one_does_not():
    truth, predicted = labels((1, 8), (2, 8)), labels((1, 4), (2, 4), (3, 6), (4, 2))
    pixels = count_confusion(truth, predicted)
    assert match_by_majority(pixels).iou.tolist() == [1, 1]
    assert match_one_to_one(pixels).iou.tolist() == [0.5, 0.75]


def test_majority_counts_what_a_prediction_covers_elsewhere():
    matched = match_by_majority(count_confusion(labels((1, 6), (2, 4)), labels((7, 8), (0, 2))))
    assert matched.iou.tolist() == [6 / 8, 0]
    assert matched.recall.tolist() == [1, 0]


def test_panoptic_quality_by_hand():
    # Instance 1: IoU 0.8. Instance 2: missed. ID 8: false positive on labelled ground. ID 9: mostly on ignored ground.
    truth = labels((1, 8), (2, 6), (0, 5))
    predicted = labels((7, 8), (7, 2), (8, 2), (9, 2), (9, 5))
    assert panoptic_quality(count_confusion(truth, predicted)) == pytest.approx(0.8 / (1 + 1 / 2 + 1 / 2))


def test_exact_half_is_no_match():
    assert panoptic_quality(count_confusion(labels((1, 4)), labels((3, 2), (0, 2)))) == 0


def test_nothing_to_find_is_none():
    pixels = count_confusion(labels((0, 4)), labels((3, 4)))
    assert panoptic_quality(pixels) is None
    assert match_one_to_one(pixels).mean_iou() is None
    assert match_by_majority(pixels).mean_recall() is None


def test_nothing_predicted_is_zero():
    pixels = count_confusion(labels((1, 4)), labels((0, 4)))
    assert match_one_to_one(pixels).mean_iou() == 0
    assert match_by_majority(pixels).mean_iou() == 0
    assert panoptic_quality(pixels) == 0


def test_permuted_ids_are_perfect():
    rng = np.random.default_rng(0)
    truth = rng.integers(1, 20, 5000).astype(np.uint32)
    names = rng.permutation(1000)[:20].astype(np.uint64) + (1 << 32)
    pixels = count_confusion(truth, names[truth])
    assert match_one_to_one(pixels).mean_iou() == match_one_to_one(pixels).mean_recall() == 1
    assert panoptic_quality(pixels) == match_by_majority(pixels).mean_iou() == 1


def test_trivial_controls_score_near_nothing():
    rng = np.random.default_rng(0)
    truth = np.repeat(np.arange(1, 21, dtype=np.uint32), 400)
    one_id = count_confusion(truth, np.ones_like(truth))
    assert match_one_to_one(one_id).mean_iou() == pytest.approx(1 / 20 / 20)
    assert panoptic_quality(one_id) == 0
    random = count_confusion(truth, rng.integers(1, 21, len(truth)).astype(np.uint32))
    score = match_one_to_one(random).mean_iou()
    assert score is not None
    assert score < 0.05
    assert panoptic_quality(random) == 0


def test_evaluated_truth_ignores_masked_pixels_first_then_tiny_instances():
    truth = labels((1, 6), (2, 6), (3, 2)).reshape(2, 7)
    ignored = np.zeros((2, 7), bool)
    ignored.flat[:3] = True
    kept = prepare_truth(truth, ignored, min_pixels=4)
    assert kept.ravel().tolist() == labels((0, 6), (2, 6), (0, 2)).tolist()
    assert truth.max() == 3, "the input is left as it is"


def view(camera: str, time: float, truth: np.ndarray, predicted: np.ndarray) -> LabelledView:
    return LabelledView(camera, time, truth[None], predicted[None])


def test_id_switches_follow_each_camera_in_time():
    truth = labels((1, 4), (2, 4))
    views = [
        view("front", 0.2, truth, labels((5, 4), (6, 4))),
        view("front", 0.0, truth, labels((5, 4), (6, 4))),
        view("front", 0.1, truth, labels((5, 4), (9, 3), (6, 1))),  # 2: 6 → 9 → 6
        view("back", 0.0, truth, labels((8, 4), (6, 4))),  # another camera may differ
    ]
    assert count_id_switches(views) == 2


def test_id_switches_pass_over_views_without_a_prediction():
    truth = labels((1, 4))
    views = [view("front", t, truth, labels((p, 4))) for t, p in [(0.0, 5), (0.1, 0), (0.2, 5), (0.3, 6)]]
    assert count_id_switches(views) == 1
