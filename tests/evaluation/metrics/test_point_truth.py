"""Which object a LiDAR point lies on: exact, and from boxes and classes; what no camera sees is left out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation_scene import DRIVING, PARKED, POLE, ROAD, ToyDrive

from instdrive_core.datasets.clip import Clip, Sweep, SweepPoints
from instdrive_core.evaluation.metrics import point_truth
from instdrive_core.evaluation.metrics.point_truth import LabelledSweep, is_in_view, label_sweeps

CLASS_NAMES = {7: "Road", 13: "Car", 22: "Pedestrian", 31: "Smoke"}


@pytest.fixture(autouse=True)
def few_points_do(monkeypatch):
    monkeypatch.setattr(point_truth, "MIN_POINTS", 1)


def with_sweeps(clip: Clip, *sweeps: Sweep) -> Clip:
    return replace(clip, sweeps=sweeps, class_names=CLASS_NAMES)


def sweep_of(index: int, points, sensor=None, classes=None, labels=None) -> Sweep:
    points = np.array(points, np.float32)
    found = SweepPoints(
        points,
        np.zeros(len(points), np.float32),
        np.zeros(len(points), np.uint8) if sensor is None else np.array(sensor, np.uint8),
        None if classes is None else np.array(classes, np.uint8),
        None if labels is None else np.array(labels, np.uint32),
    )
    return Sweep(index, index / 10, lambda: found)


def truth_of(drive: ToyDrive, points, **columns) -> LabelledSweep:
    (sweep,) = label_sweeps(with_sweeps(drive.clip, sweep_of(4, points, **columns)), drive.truth)
    return sweep


def test_exact_labels_of_held_out_sweeps_only(drive):
    points = [[2.5, 8.0, 1.6], [-3.0, 10.0, 2.0]]
    sweeps = [sweep_of(index, points, labels=[PARKED, POLE]) for index in (2, 4, 14)]
    found = label_sweeps(with_sweeps(drive.clip, *sweeps), drive.truth)
    assert [sweep.time for sweep in found] == [0.4, 1.4]
    assert found[0].truth.tolist() == [PARKED, POLE]
    np.testing.assert_allclose(found[0].points, points, rtol=1e-6)


def test_what_no_photo_has_in_its_image_is_left_out(drive):
    points = [[2.5, 8.0, 1.6], [0.0, -30.0, 0.0], [2.5, 8.0, 40.0]]
    assert truth_of(drive, points, labels=[PARKED, ROAD, POLE]).truth.tolist() == [PARKED]


def test_the_ego_vehicle_hides_points(drive):
    frame = drive.clip.held_out_frames[0]
    on_the_road = np.array([[-1.0, 1.8, 0.0], [0.0, 12.0, 0.0]], np.float32)
    pixels, _ = frame.view.camera.project(on_the_road)
    hidden = replace(frame, valid=np.arange(frame.view.camera.height)[:, None] < np.full(frame.view.camera.width, 80))
    assert pixels[0, 1] > 80 > pixels[1, 1]
    assert is_in_view(on_the_road, [hidden]).tolist() == [False, True]


def test_tiny_objects_are_ignored_over_all_sweeps(drive, monkeypatch):
    monkeypatch.setattr(point_truth, "MIN_POINTS", 3)
    points = [[2.5, 8.0, 1.6]] * 2 + [[-3.0, 10.0, 2.0]]
    sweeps = [sweep_of(index, points, labels=[PARKED, PARKED, POLE]) for index in (4, 14)]
    for sweep in label_sweeps(with_sweeps(drive.clip, *sweeps), drive.truth):
        assert sweep.truth.tolist() == [PARKED, PARKED, 0], "4 points of one, 2 of the other"


def test_a_clip_without_labels_for_points_has_none(drive):
    assert label_sweeps(drive.clip, drive.truth) == []
    assert label_sweeps(with_sweeps(drive.clip, sweep_of(4, [[2.5, 8, 1.6]])), drive.truth) == []


def test_nothing_that_trains_reads_exact_points():
    """They are in memory beside the points; only datasets, which load them, and evaluation may name them."""
    core = Path(point_truth.__file__).parents[2]
    named = {path.relative_to(core).parts[0] for path in core.rglob("*.py") if "instance_labels" in path.read_text()}
    assert named == {"datasets", "evaluation"}


class TestAnnotations:
    """Points inside boxes take the box's object where their class fits, others their class."""

    @pytest.fixture
    def annotated(self, drive):
        drive.truth.source = "annotations"
        return drive

    def test_boxes_and_classes(self, annotated):
        front = annotated.clip.tracks[1].interpolate_pose(0.4)[:3, 3]
        points = [
            [2.5, 8.0, 1.6],  # on the roof of the parked car
            [2.5, 8.0, 0.8],  # road by its class, though in the box
            [2.5, 8.0, 0.05],  # in the strip of the box that is cut off
            [*front[:2], 1.0],  # in the driving car
            [0.0, 15.0, 0.0],  # road
            [-2.0, 12.0, 0.5],  # a car without a box
            [-2.0, 14.0, 0.5],  # no surface
        ]
        classes = [13, 7, 13, 13, 7, 13, 31]
        assert truth_of(annotated, points, classes=classes).truth.tolist() == [PARKED, ROAD, 0, DRIVING, ROAD, 0, 0]

    def test_the_second_lidar_never_sees_moving_objects_where_their_box_is(self, annotated):
        front = annotated.clip.tracks[1].interpolate_pose(0.4)[:3, 3]
        points = [[2.5, 8.0, 1.6], [*front[:2], 1.0], [*front[:2], 1.2]]
        found = truth_of(annotated, points, classes=[13, 13, 7], sensor=[1, 1, 1])
        assert found.truth.tolist() == [PARKED, 0, 0]

    def test_objects_that_are_not_there_own_nothing(self, annotated):
        gone = replace(annotated.clip.tracks[1], times=annotated.clip.tracks[1].times + 100)
        annotated.clip = replace(annotated.clip, tracks=(annotated.clip.tracks[0], gone))
        front = gone.interpolate_pose(0.4)[:3, 3]
        assert truth_of(annotated, [[*front[:2], 1.0], [0, 15, 0]], classes=[13, 7]).truth.tolist() == [0, ROAD]
