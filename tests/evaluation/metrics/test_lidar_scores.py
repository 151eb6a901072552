"""Figures of points against cases made by hand and against scikit-learn."""

import numpy as np
import pytest
from sklearn.metrics import v_measure_score

from instdrive_core.evaluation.metrics.lidar_scores import LIDAR_KEYS, compute_mean_shares, score_points, v_measure
from instdrive_core.evaluation.metrics.point_ids import PointIds, PointSupport
from instdrive_core.evaluation.metrics.point_truth import LabelledSweep
from instdrive_core.evaluation.metrics.segmentation import count_confusion


def labelled(truth) -> LabelledSweep:
    truth = np.array(truth, np.uint32)
    return LabelledSweep(0.4, np.zeros((len(truth), 3), np.float32), truth)


def supported(rows) -> PointSupport:
    """Each point by one Gaussian alone."""
    return PointSupport(np.array(rows, np.int32)[:, None], np.ones((len(rows), 1), np.float32))


def scores(truth, rows, ids, codes=None):
    found = None if codes is None else np.array(codes, np.uint64)
    return score_points([labelled(truth)], [supported(rows)], np.array(ids, np.uint32), found)


def test_true_ids_are_perfect():
    figures = scores([1] * 60 + [2] * 60, [0] * 60 + [1] * 60, [7, 8], [7, 8])
    assert figures == dict.fromkeys(LIDAR_KEYS, 1.0)


def test_an_object_must_keep_its_id_in_all_sweeps():
    sweeps, supports = [labelled([1] * 60)] * 2, [supported([0] * 60), supported([1] * 60)]
    figures = score_points(sweeps, supports, np.array([7, 8], np.uint32))
    assert figures["miou"] == 0.5
    assert figures["instances_per_object"] == figures["instances_to_cover"] == 2
    assert figures["ap50"] == 1, "half of it is enough, and the other half comes later"
    assert figures["ap"] == pytest.approx(0.1)
    assert score_points(sweeps, supports, np.array([7, 7], np.uint32))["miou"] == 1


def test_a_merge_is_a_collision():
    figures = scores([1] * 60 + [2] * 60, [0] * 60 + [1] * 60, [7, 7], [3, 4])
    assert (figures["objects_per_instance"], figures["instances_per_object"]) == (2, 1)
    assert (figures["objects_per_code"], figures["codes_per_object"]) == (1, 1)
    assert figures["vmeasure"] == 0
    assert figures["miou"] == 0.25


def test_what_has_no_id_is_missed():
    figures = scores([1] * 60 + [2] * 60, [0] * 60 + [1] * 60, [7, 0])
    assert figures["ap25"] == figures["miou"] == 0.5
    assert figures["codes_per_object"] is None


def test_no_points_no_figures():
    assert score_points([], [], np.zeros(3, np.uint32)) == dict.fromkeys(LIDAR_KEYS)
    assert scores([0, 0], [0, 0], [7]) == dict.fromkeys(LIDAR_KEYS)


def test_confidence_is_the_mean_share():
    found = PointIds(np.array([4, 0, 9, 4], np.uint32), np.array([0.5, 0.9, 0.25, 1.0], np.float32))
    assert compute_mean_shares(found, np.array([4, 9])).tolist() == [0.75, 0.25]


@pytest.mark.parametrize("seed", range(5))
def test_v_measure_as_scikit_learn(seed):
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 12, 4000)
    predicted = np.where(rng.random(4000) < 0.7, truth // 2, rng.integers(0, 9, 4000))
    labelled = truth > 0
    expected = v_measure_score(truth[labelled], predicted[labelled])
    assert v_measure(count_confusion(truth, predicted)) == pytest.approx(expected, abs=1e-9)


def test_v_measure_of_one_object_and_one_id():
    assert v_measure(count_confusion(np.ones(5, int), np.ones(5, int))) == 1
    assert v_measure(count_confusion(np.array([1, 2]), np.array([1, 1]))) == 0
