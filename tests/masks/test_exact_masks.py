"""Exact labels of synthetic clips as masks and as ground truth."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from painted_street import painted_clip
from PIL import Image

from instdrive_core.errors import DataError
from instdrive_core.masks.annotated.truth import AnnotatedTruth
from instdrive_core.masks.exact import ExactLabels, has_exact_labels
from instdrive_core.masks.ground_truth import open_ground_truth
from instdrive_core.masks.label_map_folder import open_masks
from instdrive_core.masks.making import ensure_masks, make_masks

INSTANCES = {
    "1": {"class": "Road", "kind": "stuff", "moving": False, "uuid": None},
    "300": {"class": "Car", "kind": "thing", "moving": True, "uuid": "the-car"},
}


@pytest.fixture
def clip(tmp_path):
    clip = painted_clip(str(tmp_path / "clip"))
    labels = tmp_path / "clip" / "labels"
    for folder in (labels / "front_camera", labels / "sky" / "front_camera"):
        folder.mkdir(parents=True)
    for frame in clip.frames:
        raster = np.zeros((90, 160), np.uint16)
        raster[50:], raster[60:70, frame.view.index * 10 :] = 1, 300
        Image.fromarray(raster).save(labels / f"{frame.key}.png")
        sky = np.zeros((90, 160), np.uint8)
        sky[:30] = 255
        Image.fromarray(sky).save(labels / "sky" / f"{frame.key}.png")
    (labels / "instances.json").write_text(json.dumps(INSTANCES))
    return clip


def test_ground_truth_is_exact_where_labels_are_kept(clip, tmp_path):
    truth = open_ground_truth(clip)
    assert truth.source == "exact"
    car = truth.instances[300]
    assert (car.class_name, car.kind, car.moving, car.track_id) == ("Car", "thing", True, "the-car")
    assert truth.instances[1].track_id is None
    frame = clip.held_out_frames[0]
    labels = truth.load(frame)
    assert labels.dtype == np.uint32
    assert (labels[60:70, 40:] == 300).all()
    assert (labels[55] == 1).all()
    assert truth.load_sky(frame)[:30].all()
    assert not truth.load_sky(frame)[30:].any()


def test_ground_truth_is_made_from_annotations_elsewhere(tmp_path):
    clip = painted_clip(str(tmp_path))
    assert not has_exact_labels(tmp_path)
    truth = open_ground_truth(clip)
    assert isinstance(truth, AnnotatedTruth)
    assert truth.source == "annotations"
    with pytest.raises(DataError, match="has no exact labels"):
        ExactLabels(tmp_path)


def test_the_recording_car_is_nothing(clip):
    valid = np.ones((90, 160), bool)
    valid[80:] = False
    assert not ExactLabels(clip.path).load(replace(clip.frames[0], valid=valid))[80:].any()


def test_masks_of_training_frames_are_shuffled_labels(clip, tmp_path):
    masks = make_masks(clip, "exact", tmp_path / "masks", seed=3)
    assert set(masks.counts) == {"front_camera/02", "front_camera/03", "front_camera/05"}, "4 is held out"
    assert set(masks.counts.values()) == {2}
    assert not (tmp_path / "masks" / "front_camera" / "04.png").exists()
    for frame in clip.training_frames:
        found, exact = masks.load(frame), ExactLabels(clip.path).load(frame)
        assert found.labels.max() == 2, "the number of an instance shows nowhere"
        assert {len(np.unique(found.labels[exact == number])) for number in (0, 1, 300)} == {1}
        np.testing.assert_array_equal(found.sky, ExactLabels(clip.path).load_sky(frame))


def test_progress_is_told(clip, tmp_path):
    told = []
    make_masks(clip, "exact", tmp_path / "masks", on_frame=told.append)
    assert told == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[]", "from instance numbers"),
        ('{"0": {"class": "Road", "kind": "stuff"}}', "the instance 0"),
        ('{"%s": {}}' % ("9" * 5000), "from instance numbers to their facts, but '9"),
        ('{"1": {"class": "Road"}}', r"'1\.kind' is missing"),
        ('{"1": {"class": "Road", "kind": "street"}}', r"'1\.kind' is 'street'"),
    ],
)
def test_damaged_instance_tables_are_named(clip, content, message):
    (Path(clip.path) / "labels" / "instances.json").write_text(content)
    with pytest.raises(DataError, match=message):
        ExactLabels(clip.path)


def test_labels_of_unknown_instances_are_refused(clip, tmp_path):
    file = tmp_path / "clip" / "labels" / "front_camera" / "02.png"
    Image.fromarray(np.full((90, 160), 9, np.uint16)).save(file)
    with pytest.raises(DataError, match=r"02\.png: holds the instance 9, which instances\.json does not list"):
        ExactLabels(clip.path).load(clip.frames[0])


def test_a_run_takes_the_given_masks_then_the_clips_then_makes_its_own(clip, tmp_path):
    run, given = tmp_path / "run", tmp_path / "given"
    made = ensure_masks(clip.path, clip, run, None)
    assert (made.source, made.path) == ("annotations", run / "masks")
    stamp = (run / "masks" / "masks.json").stat().st_mtime_ns
    again = ensure_masks(clip.path, clip, run, None)
    assert again.path == run / "masks"
    assert (run / "masks" / "masks.json").stat().st_mtime_ns == stamp, "a resumed run keeps its masks"
    make_masks(clip, "exact", tmp_path / "clip" / "masks")
    assert ensure_masks(clip.path, clip, tmp_path / "other", None).path == tmp_path / "clip" / "masks"
    make_masks(clip, "exact", given, seed=5)
    assert ensure_masks(clip.path, clip, run, given).seed == 5
    assert not (tmp_path / "other").exists()


def test_a_clip_without_annotations_trains_without_masks(tmp_path):
    bare = replace(painted_clip(str(tmp_path)), sweeps=())
    assert ensure_masks(tmp_path, bare, tmp_path / "run", None) is None


def test_a_folder_given_as_masks_must_hold_some(clip, tmp_path):
    with pytest.raises(DataError, match="no finished folder of masks"):
        ensure_masks(clip.path, clip, tmp_path / "run", tmp_path)


def test_masks_of_annotations_are_the_same_bits_again(clip, tmp_path):
    for name in ("one", "two"):
        make_masks(clip, "annotations", tmp_path / name, seed=1)
    for key in open_masks(tmp_path / "one").counts:
        assert (tmp_path / "one" / f"{key}.png").read_bytes() == (tmp_path / "two" / f"{key}.png").read_bytes()
