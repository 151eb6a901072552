"""Average precision against cases counted by hand and against pycocotools."""

import contextlib
import io

import numpy as np
import pytest
from pycocotools import mask as rle
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from instdrive_core.evaluation.metrics.average_precision import AP_THRESHOLDS, average_precision
from instdrive_core.evaluation.metrics.segmentation import count_confusion


def ap(truth, predicted, confidences, thresholds=(0.5,), min_size=0):
    counts = count_confusion(np.array(truth), np.array(predicted))
    return average_precision(counts, np.array(confidences, float), thresholds, min_size)


def test_every_object_found():
    assert ap([1, 1, 2, 2], [8, 8, 9, 9], [0.1, 0.2], AP_THRESHOLDS) == 1


def test_nothing_to_find_and_nothing_found():
    assert ap([0, 0], [1, 1], [1]) is None
    assert ap([1, 1], [0, 0], []) == 0


def test_a_false_positive_costs_by_its_rank():
    truth = [1] * 10 + [2] * 10
    predicted = [5] * 10 + [6] * 6 + [7] * 4
    assert ap(truth, predicted, [0.9, 0.8, 0.1]) == 1, "it comes last: full recall was reached before"
    assert ap(truth, predicted, [0.9, 0.5, 0.8]) == pytest.approx((1 + 2 / 3) / 2)
    assert ap(truth, predicted, [0.8, 0.5, 0.9]) == pytest.approx((2 / 3 + 2 / 3) / 2)


def test_a_missed_object_costs_recall():
    assert ap([1, 1, 2, 2], [5, 5, 0, 0], [1]) == 0.5


def test_thresholds_are_reached_not_passed():
    assert ap([1] * 4, [5, 5, 0, 0], [1], (0.5,)) == 1
    assert ap([1] * 4, [5, 5, 0, 0], [1], (0.55,)) == 0


def test_small_and_ignored_predictions_are_excused():
    truth = [1] * 10 + [2] * 5 + [0] * 10
    predicted = [5] * 10 + [6] * 2 + [0] * 3 + [7] * 10
    confidences = [0.1, 0.8, 0.9]
    assert ap(truth, predicted, confidences, min_size=3) == 0.5
    assert ap(truth, predicted, confidences) == 0.25, "the small one is a false positive before the hit"


def encoded(mask):
    return rle.encode(np.asfortranarray(mask[:, None].astype(np.uint8)))


def coco_ap(truth, predicted, confidences, min_size):
    """Average precision by COCO's code: points are an image one pixel wide, recall in steps of a thousandth."""
    objects, found = np.unique(truth[truth > 0]), np.unique(predicted[predicted > 0])
    size = {"height": len(truth), "width": 1}
    annotations = [
        {"id": k, "image_id": 1, "category_id": 1, "iscrowd": 0, "area": int((truth == k).sum())}
        | {"segmentation": encoded(truth == k)}
        for k in objects.tolist()
    ]
    if (truth == 0).any():
        annotations.append(
            {"id": int(objects.max()) + 1, "image_id": 1, "category_id": 1, "iscrowd": 1}
            | {"area": int((truth == 0).sum()), "segmentation": encoded(truth == 0)}
        )
    with contextlib.redirect_stdout(io.StringIO()):
        ground_truth = COCO()
        ground_truth.dataset = {
            "info": {}, "images": [{"id": 1, **size}], "categories": [{"id": 1}], "annotations": annotations,
        }  # fmt: skip
        ground_truth.createIndex()
        results = [
            {"image_id": 1, "category_id": 1, "segmentation": encoded(predicted == k), "score": float(confidence)}
            for k, confidence in zip(found.tolist(), confidences, strict=True)
        ]
        measured = COCOeval(ground_truth, ground_truth.loadRes(results), "segm")
        measured.params.recThrs = np.linspace(0, 1, 1001)
        measured.params.areaRng, measured.params.areaRngLbl = [[min_size, 1e9]], ["all"]
        measured.params.maxDets = [1000]
        measured.evaluate()
        measured.accumulate()
    precision = measured.eval["precision"][:, :, 0, 0, 0]
    return precision.mean(axis=1)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("ignored", [False, True])
def test_as_coco(seed, ignored):
    """Ignored points are a crowd; whole predictions lie in it, since COCO counts them into IoU otherwise."""
    rng = np.random.default_rng(seed)
    truth = np.repeat(np.arange(1, 31), rng.integers(20, 80, 30))
    predicted = truth + 100
    for _ in range(25):  # pieces, merges and shifts
        start, length = rng.integers(len(truth)), rng.integers(5, 60)
        predicted[start : start + length] = rng.integers(101, 145)
    if ignored:
        truth = np.append(truth, np.zeros(200, int))
        predicted = np.append(predicted, np.repeat([201, 202, 203, 204], 50))
    confidences = rng.random(len(np.unique(predicted)))
    ours = [ap(truth, predicted, confidences, (threshold,), 15) for threshold in AP_THRESHOLDS]
    assert ours == pytest.approx(coco_ap(truth, predicted, confidences, 15), abs=0.002)
    assert 0.05 < np.mean(ours) < 0.95
    mean = ap(truth, predicted, confidences, AP_THRESHOLDS, 15)
    assert mean == pytest.approx(np.mean(ours))
