"""Masks made from cuboids, classes and LiDAR against a street whose every pixel is known, and on the real clip."""

from dataclasses import replace

import numpy as np
import pytest
from painted_street import CAR, CAR_SIZE, CLASSES, ROAD, SKY, WALL, camera, car_center, painted_clip, truth

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.masks.annotated.labelled_cloud import assign_boxes, build_cloud
from instdrive_core.masks.annotated.labels import AnnotationLabels, has_annotations, open_borders
from instdrive_core.masks.image.point_drawing import draw_points
from instdrive_core.masks.image.spreading import spread_labels


@pytest.fixture(scope="module")
def clip():
    return painted_clip("")


@pytest.fixture(scope="module")
def labels(clip):
    return AnnotationLabels(clip, held_out=True)


def named(labels, class_name):
    return next(number for number, one in labels.instances.items() if one.class_name == class_name)


def iou(one, other):
    return (one & other).sum() / (one | other).sum()


def test_every_pixel_gets_what_it_shows(clip, labels):
    for frame in clip.frames:
        found, expected = labels.load(frame), truth(frame.view.time)
        assert iou(found == named(labels, "Car"), expected == CAR) > 0.9
        assert iou(found == named(labels, "Road"), expected == ROAD) > 0.95
        assert iou(found == named(labels, "Building"), expected == WALL) > 0.93
        assert iou(labels.load_sky(frame), expected == SKY) > 0.95
        assert (found > 0).sum() + labels.load_sky(frame).sum() > 0.99 * found.size


def test_instances_say_what_they_are(labels):
    car, road = labels.instances[named(labels, "Car")], labels.instances[named(labels, "Road")]
    assert (car.kind, car.moving, car.track_id) == ("thing", True, "the-car")
    assert (road.kind, road.moving, road.track_id) == ("stuff", False, None)
    assert "Lane Line Marking" not in {one.class_name for one in labels.instances.values()}, "it is part of the road"


def test_things_stay_whole_where_lidar_missed_them(clip):
    """Dark paint returns nothing: the box and a few points must do."""

    def without_most_of_the_car(sweep):
        points = sweep.load()
        kept = (points.classes != CAR) | (np.arange(len(points.points)) % 20 == 0)
        fields = ("points", "intensity", "sensor", "classes")
        return replace(points, **{name: getattr(points, name)[kept] for name in fields})

    sweeps = tuple(replace(sweep, load=lambda sweep=sweep: without_most_of_the_car(sweep)) for sweep in clip.sweeps)
    labels = AnnotationLabels(replace(clip, sweeps=sweeps), held_out=True)
    frame = clip.frames[0]
    assert iou(labels.load(frame) == named(labels, "Car"), truth(frame.view.time) == CAR) > 0.75


def test_the_recording_car_is_left_out(clip, labels):
    valid = np.ones((90, 160), bool)
    valid[70:] = False
    found = labels.load(replace(clip.frames[0], valid=valid))
    assert not found[70:].any()
    assert found[60:70].all()


def test_held_out_sweeps_are_only_read_for_evaluation(clip):
    read = []
    sweeps = tuple(
        replace(sweep, load=lambda sweep=sweep: (read.append(sweep.index), sweep.load())[1]) for sweep in clip.sweeps
    )
    build_cloud(replace(clip, sweeps=sweeps), held_out=False)
    assert read == [2, 3, 5]
    read.clear()
    build_cloud(replace(clip, sweeps=sweeps), held_out=True)
    assert read == [2, 3, 4, 5]


def test_a_clip_without_annotations_is_refused(clip):
    bare = replace(clip, sweeps=())
    assert has_annotations(clip)
    assert not has_annotations(bare)
    with pytest.raises(DataError, match="has no annotations"):
        AnnotationLabels(bare, held_out=False)


def without_classes(clip):
    sweeps = tuple(replace(s, load=lambda s=s: replace(s.load(), classes=None)) for s in clip.sweeps)
    return replace(clip, sweeps=sweeps, class_names={})


def test_boxes_without_classes_still_give_things(clip):
    labels = AnnotationLabels(without_classes(clip), held_out=True)
    for frame in clip.frames:
        found, expected = labels.load(frame), truth(frame.view.time)
        assert set(np.unique(found)) == {0, named(labels, "Car")}
        assert iou(found > 0, expected == CAR) > 0.85


def test_without_classes_only_the_sky_is_sky(clip):
    """Points that nobody named are surfaces all the same: what lies around them is no sky."""
    labels = AnnotationLabels(without_classes(clip), held_out=True)
    for frame in clip.frames:
        assert iou(labels.load_sky(frame), truth(frame.view.time) == SKY) > 0.95


def test_a_thing_behind_a_wall_is_not_seen(clip):
    behind = clip.tracks[0].world_from_box.copy()
    behind[:, 1, 3] = 30.0
    hidden = replace(clip.tracks[0], id="hidden", world_from_box=behind)
    labels = AnnotationLabels(replace(clip, tracks=(*clip.tracks, hidden)), held_out=True)
    number = next(number for number, one in labels.instances.items() if one.track_id == "hidden")
    assert not (labels.load(clip.frames[0]) == number).any()


def assign(points, classes=None, sensors=None, moving=False, second_box=None):
    centers = [car_center(0)] if second_box is None else [car_center(0), second_box]
    poses = np.tile(np.eye(4), (len(centers), 1, 1))
    poses[:, :3, 3] = centers
    fits = np.zeros((len(centers), 256), bool)
    fits[:, [0, CAR]] = True
    count = len(points)
    return assign_boxes(
        (car_center(0) + np.array(points)).astype(np.float32),
        np.full(count, CAR, np.uint8) if classes is None else np.array(classes, np.uint8),
        np.zeros(count, np.uint8) if sensors is None else np.array(sensors, np.uint8),
        poses,
        np.tile(CAR_SIZE / 2, (len(centers), 1)),
        np.full(len(centers), moving),
        fits,
    )


def test_points_belong_to_the_box_they_are_in():
    box, near = assign([[0, 0, 0], [0, 2.05, 0], [0, 2.5, 0], [0, 0, -0.7], [0, 0, 0.8]])
    assert box.tolist() == [0, 0, -1, -1, 0], "the lower face is cut off: there lies the road"
    assert not near.any()


def test_points_of_another_class_belong_to_no_box():
    assert assign([[0, 0, 0]], classes=[WALL])[0].tolist() == [-1]
    assert assign([[0, 0, 0]], classes=[WALL], moving=True)[0].tolist() == [-2], "and to nothing that stands still"


def test_the_second_lidars_points_belong_to_no_moving_box():
    assert assign([[0, 0, 0]], sensors=[1])[0].tolist() == [0]
    box, near = assign([[0, 0, 0], [0, 2.8, 0], [0, 3.5, 0]], sensors=[1, 1, 1], moving=True)
    assert box.tolist() == [-2, -1, -1]
    assert near.tolist() == [True, True, False]


def test_of_overlapping_boxes_the_one_in_whose_middle_a_point_lies_wins():
    box, _ = assign([[0.2, 0, 0], [0.8, 0, 0]], second_box=car_center(0) + np.array([1.0, 0, 0]))
    assert box.tolist() == [0, 1]


def test_models_are_mirrored_thinned_and_without_strays(clip):
    def one_sided(sweep):
        points = sweep.load()
        side = np.array([[0.92, y, z] for y in np.arange(-1.5, 1.5, 0.02) for z in np.arange(-0.4, 0.4, 0.02)])
        stray = np.array([[-0.9, 1.9, 0.74]])
        local = np.concatenate([side, stray]) + car_center(sweep.time)
        ones = np.ones(len(local))
        return replace(
            points,
            points=local.astype(np.float32),
            intensity=ones.astype(np.float32),
            sensor=(0 * ones).astype(np.uint8),
            classes=(CAR * ones).astype(np.uint8),
        )

    sweeps = tuple(replace(sweep, load=lambda sweep=sweep: one_sided(sweep)) for sweep in clip.sweeps)
    cloud = build_cloud(replace(clip, sweeps=sweeps), held_out=True)
    (model,) = cloud.models.values()
    assert len(model) < 3 * 150 * 40
    assert np.isclose(model[:, 0], 0.92).sum() == pytest.approx(np.isclose(model[:, 0], -0.92).sum(), rel=0.2)
    assert model[:, 2].max() < 0.7, "the stray is gone"


def test_splats_cover_their_pixel_and_the_nearest_wins():
    view = camera()
    half = 0.5 / 120  # a pixel's half at 1 m: the points project onto pixel centres
    points = np.array([[half * 10, 10, 1.6], [half * 5, 5, 1.6], [0, -5, 1.6], [500, 5, 1.6]], np.float32)
    points[:, 2] -= half * np.abs(points[:, 1])
    labels, depths = draw_points(points, np.array([1, 2, 3, 4], np.uint32), view, 0.001)
    assert labels[45, 80] == 2
    assert depths[45, 80] == pytest.approx(5)
    assert (labels > 0).sum() == 1
    assert np.isinf(depths[labels == 0]).all()
    labels, _ = draw_points(points[:1], np.array([1], np.uint32), view, 1.0)
    assert (labels > 0).sum() == 12 * 12, "1 m at 10 m is 12 pixels"


def test_labels_meet_at_the_edge_of_the_photo():
    image = np.zeros((20, 40, 3), np.uint8)
    image[:, 25:] = 200
    seeds = np.full((20, 40), -1, np.int32)
    seeds[10, 2], seeds[5, 38] = 0, 1
    limits = np.full(2, 1e6, np.float32)
    filled = spread_labels(seeds, image, limits, np.ones((20, 40), bool), range(5, 6))
    assert (filled[:, :24] == 0).all()
    assert (filled[:, 26:] == 1).all()


def test_labels_spread_up_to_their_limit_and_things_where_they_may():
    image = np.zeros((1, 30, 3), np.uint8)
    seeds = np.full((1, 30), -1, np.int32)
    seeds[0, 0] = 0
    filled = spread_labels(seeds, image, np.array([7], np.float32), np.ones((1, 30), bool), range(5, 6))
    assert (filled[0] == 0).sum() == 8
    allowed = np.arange(30)[None] < 4
    filled = spread_labels(seeds, image, np.array([7], np.float32), allowed, range(1))
    assert (filled[0] == 0).sum() == 4


def test_borders_are_opened_but_small_things_kept():
    labels = np.zeros((20, 20), np.int32)
    labels[:, 10:] = 1
    labels[3:5, 3:5] = 2
    opened = open_borders(labels, 1)
    assert (opened[:, [9, 10]] == -1).all()
    assert (opened[8:, :9] == 0).all()
    assert (opened == 2).sum() == 4


@pytest.mark.slow
def test_the_real_clip_gives_whole_cars_one_road_and_a_sky(pandaset_clip):
    clip = load_clip(str(pandaset_clip), ClipOptions(first_frame=40, last_frame=44))
    labels = AnnotationLabels(clip, held_out=False)
    ego = {}
    for frame in clip.frames:
        if frame.view.index != 41:
            continue
        found, sky = labels.load(frame), labels.load_sky(frame)
        assert not (sky & (found > 0)).any()
        assert not sky[frame.view.camera.height // 2 + 40 :].any(), f"{frame.key}: sky below the horizon"
        open_share = ((found == 0) & ~sky)[frame.valid if frame.valid is not None else slice(None)].mean()
        assert open_share < 0.08, frame.key
        ego[frame.view.name] = sky.mean()
        roads = [number for number, one in labels.instances.items() if one.class_name == "Road"]
        road = np.isin(found, roads)
        assert road[-10:].any() or frame.view.name in ("right_camera", "back_camera")
    assert ego["left_camera"] > 0.3
    assert ego["front_right_camera"] < 0.25
    things = {one.id for one in labels.instances.values() if one.kind == "thing"}
    front = next(frame for frame in clip.frames if frame.key == "front_camera/41")
    counts = np.bincount(labels.load(front).ravel())
    assert sum(counts[number] > 50 for number in things if number < len(counts)) >= 8
    assert CLASSES[CAR] in {labels.instances[number].class_name for number in things}
