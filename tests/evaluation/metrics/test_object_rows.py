"""One row per object, on maps written by hand."""

import numpy as np
import pytest

from instdrive_core.evaluation.metrics.object_rows import list_object_rows
from instdrive_core.evaluation.metrics.segmentation import LabelledView
from instdrive_core.evaluation.metrics.sharing import Holding
from instdrive_core.masks.ground_truth import GroundTruthInstance

INSTANCES = {
    1: GroundTruthInstance(1, "road", "Road", "stuff"),
    2: GroundTruthInstance(2, "the van", "Car", "thing", True, "van"),
    3: GroundTruthInstance(3, "sign", "Signs", "thing"),
}
TRUTH = np.array([[1] * 10, [1] * 6 + [2] * 4, [0] * 8 + [3] * 2])


def view(predicted, time=0.0) -> LabelledView:
    return LabelledView("front", time, TRUTH, np.array(predicted))


def test_rows_of_two_views():
    first = view([[7] * 10, [7] * 6 + [8] * 4, [0] * 10])
    second = view([[7] * 10, [7] * 6 + [9] * 4, [0] * 10], 0.1)
    road, van, sign = list_object_rows([first, second], None, INSTANCES)
    assert (road.name, road.class_name, road.kind, road.moving) == ("road", "Road", "stuff", False)
    assert (road.pixels, road.predicted_id, road.iou, road.recall) == (32, 7, 1.0, 1.0)
    assert (van.moving, van.pixels, van.iou, van.recall) == (True, 8, 0.5, 0.5)
    assert van.predicted_id in (8, 9)
    assert van.instances == (Holding(8, 0.5), Holding(9, 0.5))
    assert len(van.instances) > 1
    assert len(road.instances) == 1
    assert (sign.predicted_id, sign.iou, sign.recall, sign.instances, sign.codes) == (None, 0, 0, (), None)


def test_codes_are_counted_apart():
    shown = view([[7] * 10, [7] * 6 + [8] * 4, [0] * 8 + [9] * 2])
    coded = view([[3] * 10, [3] * 10, [0] * 8 + [4] * 2])
    road, van, sign = list_object_rows([shown], [coded], INSTANCES)
    assert road.codes == van.codes == (Holding(3, 1.0),)
    assert sign.codes == (Holding(4, 1.0),)
    assert van.instances == (Holding(8, 1.0),)


def test_a_match_that_shares_nothing_is_none():
    shown = view([[7] * 10, [7] * 10, [8] * 8 + [7] * 2])
    rows = {row.id: row for row in list_object_rows([shown], None, INSTANCES)}
    assert rows[1].predicted_id == 7
    assert rows[1].iou == pytest.approx(16 / 22)
    assert rows[2].predicted_id is None
    assert rows[2].instances == (Holding(7, 1.0),), "yet it is clear what took it"
