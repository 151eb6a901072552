"""Masks from bare LiDAR points: each step on shapes that are known, the whole on a painted street and the real clip."""

from dataclasses import replace

import numpy as np
import pytest
from painted_street import CAR, ROAD, SKY, WALL, painted_clip, truth

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.masks.annotated.labels import OPEN
from instdrive_core.masks.lidar.cluster_kind import FACADE, GROUND, NONE, THING, VEGETATION, classify_clusters
from instdrive_core.masks.lidar.cluster_motion import MovingCluster, complete_clusters
from instdrive_core.masks.lidar.cluster_parts import claim_insides, join_splinters, join_vehicle_parts
from instdrive_core.masks.lidar.clusters import absorb_small_clusters, cluster_points, thin_rows
from instdrive_core.masks.lidar.ground import find_ground, is_ground
from instdrive_core.masks.lidar.labels import LidarLabels
from instdrive_core.masks.lidar.moving_points import ClusteredSweep, find_moving_clusters
from instdrive_core.masks.lidar.point_shape import compute_point_shape
from instdrive_core.masks.lidar.regions import fill_label_holes, vote_by_superpixel
from instdrive_core.masks.lidar.see_through import build_range_image, is_seen_through
from instdrive_core.masks.lidar.walls import join_wide


def box(low, high, count, rng):
    return rng.uniform(low, high, (count, 3)).astype(np.float32)


def iou(one, other):
    return (one & other).sum() / (one | other).sum()


def test_ground_is_found_under_cars_on_a_slope_and_above_mirror_images():
    rng = np.random.default_rng(0)
    places = rng.uniform(-20, 20, (60000, 2))
    on_car = (np.abs(places) < [2.3, 1.0]).all(axis=1)
    road = np.column_stack([places, 0.03 * places[:, 0] + rng.normal(0, 0.02, len(places))])[~on_car]
    car = box([-2.3, -1, 0.5], [2.3, 1, 1.5], 2000, rng)
    wall = box([-20, 15, 0], [20, 15.1, 6], 8000, rng)
    wall[:, 2] += 0.03 * wall[:, 0]
    mirrored = box([5, 5, -3], [9, 8, -1], 1500, rng)
    surface = find_ground(np.concatenate([road, car, wall, mirrored]).astype(np.float32))
    distance = np.full(60000, 10, np.float32)
    assert is_ground(surface.compute_heights_above(road.astype(np.float32)), distance[: len(road)]).mean() > 0.98
    assert not is_ground(surface.compute_heights_above(car), distance[: len(car)]).any()
    high = wall[:, 2] - 0.03 * wall[:, 0] > 0.4
    assert is_ground(surface.compute_heights_above(wall[high]), distance[: high.sum()]).mean() < 0.01


def test_ground_needs_points():
    with pytest.raises(ValueError, match="no points"):
        find_ground(np.zeros((0, 3), np.float32))


def test_reach_grows_with_distance():
    row = np.column_stack([np.arange(0, 2, 0.2), np.zeros((10, 2))])
    pair = np.concatenate([row, row + np.array([2.4, 0, 0])]).astype(np.float32)
    for reach, expected in ((0.4, 2), (0.8, 1)):
        numbers = cluster_points(pair, np.full(20, reach, np.float32))
        assert len(np.unique(numbers)) == expected
    mixed = np.repeat([0.8, 0.4], 10).astype(np.float32)
    assert len(np.unique(cluster_points(pair, mixed))) == 2, "the smaller reach counts"
    groups = np.repeat([0, 1], 10)
    assert len(np.unique(cluster_points(pair, np.full(20, 0.8, np.float32), groups))) == 2


def test_thinning_keeps_a_point_of_each_cell():
    points = np.array([[0.01, 0, 0], [0.02, 0, 0], [0.11, 0, 0], [-0.01, 0, 0]], np.float32)
    assert thin_rows(points, 0.1).tolist() == [0, 2, 3]


def test_splinters_join_what_is_near():
    points = np.array([[0.1 * n, 0, 0] for n in range(20)] + [[2.3, 0, 0], [9.0, 0, 0]], np.float32)
    numbers = np.repeat([0, 1, 2], [20, 1, 1]).astype(np.int32)
    joined = absorb_small_clusters(points, numbers, np.full(22, 0.3, np.float32))
    assert len(set(joined[:21])) == 1
    assert joined[21] != joined[0]


def test_small_clusters_inside_larger_ones_are_parts_of_them():
    rng = np.random.default_rng(0)
    crown = box([0, 0, 0], [3, 3, 3], 9000, rng)
    numbers = (np.abs(crown - 1.5) < 0.4).all(axis=1).astype(np.int32)
    away = box([8, 0, 0], [8.8, 0.8, 1], 300, rng)
    points, numbers = np.concatenate([crown, away]), np.append(numbers, np.full(300, 2, np.int32))
    joined = join_splinters(points, numbers, np.full(len(points), 0.4, np.float32))
    assert len(set(joined[:9000])) == 1
    assert set(joined[9000:]).isdisjoint(joined[:9000])


def test_parts_of_a_car_are_joined_but_not_two_cars_or_a_person_beside_it():
    rng = np.random.default_rng(0)
    hood = box([0, 0, 0.3], [1.2, 1.8, 1.0], 200, rng)
    cabin = box([1.6, 0.1, 0.8], [4.3, 1.7, 1.5], 400, rng)
    parked_next = box([5.0, 0, 0.3], [9.3, 1.8, 1.5], 500, rng)
    person = box([2.0, 2.1, 0.2], [2.5, 2.6, 1.7], 150, rng)
    points = np.concatenate([hood, cabin, parked_next, person])
    numbers = np.repeat([7, 3, 5, 2], [200, 400, 500, 150]).astype(np.int32)
    joined = join_vehicle_parts(points, numbers, points[:, 2])
    found = [set(joined[start:end].tolist()) for start, end in ((0, 600), (600, 1100), (1100, 1250))]
    assert [len(one) for one in found] == [1, 1, 1]
    assert len(set.union(*found)) == 3
    outside = join_vehicle_parts(points, np.full(len(points), -1, np.int32), points[:, 2])
    assert (outside == -1).all()


def test_kinds_follow_size_and_shape():
    rng = np.random.default_rng(0)
    wall = box([0, 0, 0.3], [12, 0.02, 6], 12000, rng)
    crown = box([0, 10, 2], [3, 13, 5], 4000, rng)
    car = np.concatenate([box([0, 20, 0.3], [4, 20.02, 1.4], 900, rng), box([0, 20, 1.4], [4, 21.7, 1.42], 900, rng)])
    curb = box([0, 30, 0.2], [3, 30.1, 0.3], 200, rng)
    stray = box([0, 40, 1], [0.1, 40.1, 1.1], 3, rng)
    parts = [wall, crown, car, curb, stray]
    points = np.concatenate(parts)
    numbers = np.repeat(np.arange(5), [len(part) for part in parts]).astype(np.int32)
    kinds = classify_clusters(points, numbers, compute_point_shape(points), points[:, 2])
    assert kinds.tolist() == [FACADE, VEGETATION, THING, GROUND, NONE]


def test_a_place_is_empty_if_a_beam_went_on_behind_it():
    rng = np.random.default_rng(0)
    wall = np.column_stack([rng.uniform(-10, 10, 40000), np.full(40000, 20.0), rng.uniform(-2, 4, 40000)])
    image = build_range_image(wall.astype(np.float32), np.zeros(3))
    points = np.array([[0, 10, 0], [0, 19.8, 0], [0, 25, 0], [0, -10, 0]], np.float32)
    assert is_seen_through(points, image).tolist() == [True, False, False, False]


def test_motion_is_found_between_sweeps_and_completes_what_moves():
    rng = np.random.default_rng(0)
    car, other = box([0, 0, 0], [4, 2, 1.5], 300, rng), box([12, 0, 0], [16, 2, 1.5], 300, rng)
    shift = np.array([1.6, 0, 0], np.float32)
    by_time = {
        time: [
            MovingCluster(2 * step + 10, car + shift * step, np.zeros(3)),
            MovingCluster(2 * step + 11, other[step::2] - shift * step, np.zeros(3)),
        ]
        for step, time in enumerate((0.0, 0.2, 0.4))
    }
    for step, clusters in enumerate(complete_clusters(by_time).values()):
        assert clusters[0].velocity == pytest.approx([8, 0, 0], abs=0.3)
        assert clusters[1].velocity == pytest.approx([-8, 0, 0], abs=0.6)
        assert len(clusters[1].points) > 250
        assert (np.abs(clusters[1].points - other.mean(axis=0) + shift * step) < [2.3, 1.3, 1.1]).all()
    alone = complete_clusters({0.0: by_time[0.0], 5.0: by_time[0.4]})
    assert not alone[0.0][0].velocity.any(), "the next sweep is too late to tell"


def test_what_moves_is_followed_where_no_beam_went_through_its_place():
    """A car driving away straight ahead hides its own path: only later sweeps see through its first places."""
    rng = np.random.default_rng(0)
    wall = np.column_stack([rng.uniform(-10, 10, 20000), np.full(20000, 60.0), rng.uniform(-1, 6, 20000)])
    parked = box([6, 20, 0], [8, 24, 1.5], 400, rng)
    sweeps = []
    for step in range(6):
        car = box([-1, 10 + 2 * step, 0], [1, 14 + 2 * step, 1.5], 1500, rng)
        numbers = np.repeat([0, 1, 2], [20000, 400, 1500]).astype(np.int32)
        points = np.concatenate([wall, parked, car]).astype(np.float32)
        hidden = (np.abs(points[:, 0] / points[:, 1]) < 0.05) & (points[:, 1] > 59)
        sweeps.append(ClusteredSweep(0.2 * step, np.zeros(3), points[~hidden], numbers[~hidden]))
    for moves in find_moving_clusters(sweeps):
        assert moves.tolist() == [False, False, True]


def test_superpixels_take_the_label_that_prevails():
    image = np.zeros((40, 60, 3), np.uint8)
    image[:, 30:] = 200
    seeds = np.full((40, 60), OPEN, np.int32)
    seeds[::4, 2:28:4] = 0
    seeds[::4, 32::4] = 1
    voted = vote_by_superpixel(seeds, image, np.ones((40, 60), bool), range(1, 2))
    assert (voted[:, :29] == 0).mean() > 0.9
    assert (voted[:, 31:] == 1).mean() > 0.9
    voted = vote_by_superpixel(seeds, image, np.zeros((40, 60), bool), range(1, 2))
    assert (voted[:, :29] == 0).mean() > 0.9
    assert (voted == 1).sum() == (seeds == 1).sum(), "things stay where they may be"


def test_what_is_seen_through_a_window_belongs_to_the_car_but_not_what_stands_before_it():
    labels, depths = np.zeros((60, 80), np.int32), np.full((60, 80), 20, np.float32)
    labels[30:] = 1
    labels[20:45, 20:60], depths[20:45, 20:60] = 3, 8
    labels[24:28, 30:36], depths[24:28, 30:36] = 0, 15
    labels[30:34, 48:52], depths[30:34, 48:52] = 4, 6
    labels[36:38, 40:42], depths[36:38, 40:42] = OPEN, np.inf
    labels[50:54, 10:14], depths[50:54, 10:14] = 5, 20
    labels[5:8, 5:8] = 2
    filled = fill_label_holes(labels, depths, floors=range(1, 2), things=range(3, 6))
    assert (filled[24:28, 30:36] == 3).all()
    assert (filled[36:38, 40:42] == 3).all()
    assert (filled[30:34, 48:52] == 4).all(), "in front of the car"
    assert (filled[50:54, 10:14] == 5).all(), "a thing on the floor"
    assert (filled[5:8, 5:8] == 0).all()
    assert (filled[:20, 20:] == 0).all()


def test_seats_met_through_glass_belong_to_the_car_and_what_lies_beside_or_above_it_does_not():
    rng = np.random.default_rng(0)
    shell = box([0, 0, 0.3], [4.4, 1.8, 1.5], 4000, rng)
    shell = shell[(shell[:, 1] < 0.1) | (shell[:, 2] > 1.4) | (shell[:, 0] < 0.1) | (shell[:, 0] > 4.3)]
    seats, branch = box([1, 0.5, 0.8], [3, 1.4, 1.3], 100, rng), box([1, 0.5, 2.0], [3, 1.4, 3.0], 100, rng)
    hedge = box([0, 2.2, 0.3], [4.4, 2.8, 1.5], 100, rng)
    shed = box([10, 0, 0], [16, 5, 2.4], 3000, rng)
    inside_shed = box([12, 1, 1], [14, 3, 2], 100, rng)
    parts = (shell, seats, branch, hedge, shed, inside_shed)
    clusters = np.repeat(np.arange(6), [len(part) for part in parts]).astype(np.int32)
    points = np.concatenate(parts)
    claimed = claim_insides(points, clusters, [0, 4], points[:, 2])
    assert (claimed[clusters == 1] == 0).all()
    assert all((claimed[clusters == number] == number).all() for number in (0, 2, 3, 4, 5))


def test_a_wall_cut_by_windows_and_its_cornice_are_one_facade_and_the_house_opposite_is_another():
    rng = np.random.default_rng(0)
    wall = [box([x, 0, 0], [x + 3, 0.1, 4], 400, rng) for x in (0, 3.8, 7.6)]
    cornice = box([0, 0.3, 6], [10.6, 0.5, 7], 400, rng)
    opposite = box([0, 12, 0], [10, 12.1, 5], 400, rng)
    tree = box([4, -1, 1], [6, -0.2, 4], 400, rng)
    parts = (*wall, cornice, opposite, tree)
    clusters = np.repeat(np.arange(6), [len(part) for part in parts]).astype(np.int32)
    kinds = np.array([FACADE] * 5 + [VEGETATION], np.uint32)
    points = np.concatenate(parts)
    joined = join_wide(points, clusters, kinds, np.full(len(points), 10, np.float32))
    assert [np.unique(joined[clusters == number]).tolist() for number in range(6)] == [[0]] * 4 + [[4], [5]]
    far = join_wide(points * 3, clusters, kinds, np.full(len(points), 80, np.float32))
    assert set(far[clusters < 3]) == {0}, "far away, points lie farther apart"


@pytest.fixture(scope="module")
def street():
    return painted_clip("", range(2, 16))


@pytest.fixture(scope="module")
def labels(street):
    return LidarLabels(street)


def test_street_wall_car_and_sky_are_found_without_annotations(street, labels):
    for frame in street.training_frames[::5]:
        found, expected = labels.load(frame), truth(frame.view.time)
        car = found[expected == CAR]
        assert iou(found == np.bincount(car[car > 0]).argmax(), expected == CAR) > 0.7
        assert iou(found == GROUND, expected == ROAD) > 0.9
        wall = np.bincount(found[expected == WALL]).argmax()
        assert iou(found == wall, expected == WALL) > 0.85
        assert iou(labels.load_sky(frame), expected == SKY) > 0.9
        assert not (labels.load_sky(frame) & (found > 0)).any()


def test_neither_classes_nor_cuboids_change_anything(street, labels):
    sweeps = tuple(replace(s, load=lambda s=s: replace(s.load(), classes=None)) for s in street.sweeps)
    bare = LidarLabels(replace(street, sweeps=sweeps, tracks=(), class_names={}))
    for frame in street.training_frames[::5]:
        np.testing.assert_array_equal(bare.load(frame), labels.load(frame))


def test_held_out_sweeps_are_not_read(street):
    read = []
    sweeps = tuple(
        replace(sweep, load=lambda sweep=sweep: (read.append(sweep.index), sweep.load())[1]) for sweep in street.sweeps
    )
    LidarLabels(replace(street, sweeps=sweeps))
    assert sorted(set(read)) == [index for index in range(2, 16) if index not in (4, 14)]


def test_the_recording_car_is_left_out(street, labels):
    valid = np.ones((90, 160), bool)
    valid[70:] = False
    found = labels.load(replace(street.frames[0], valid=valid))
    assert not found[70:].any()
    assert found[60:70].all()


def test_a_clip_without_lidar_is_refused(street):
    with pytest.raises(DataError, match="no LiDAR"):
        LidarLabels(replace(street, sweeps=()))


@pytest.mark.slow
def test_the_real_clip_gives_cars_a_road_and_a_sky(pandaset_clip):
    clip = load_clip(str(pandaset_clip), ClipOptions(cameras="front_left_camera", first_frame=36, last_frame=46))
    labels = LidarLabels(clip)
    frame = next(frame for frame in clip.frames if frame.view.index == 40)
    found, sky = labels.load(frame), labels.load_sky(frame)
    assert labels.source == "lidar"
    assert sky[:80].mean() > 0.6
    assert (found[200:] == GROUND).mean() > 0.6
    assert (found > 0).sum() + sky.sum() > 0.95 * found.size
    car = np.bincount(found[160:190, 350:450].ravel()).argmax()
    assert car > GROUND
    assert iou(found == car, np.pad(np.ones((60, 115), bool), ((140, 70), (333, 32)))) > 0.6


def test_a_few_points_are_enough_to_go_on(street):
    def first_points(sweep):
        points = sweep.load()
        columns = ("points", "intensity", "sensor", "classes")
        return replace(points, **{name: getattr(points, name)[:5] for name in columns})

    sweeps = tuple(replace(sweep, load=lambda sweep=sweep: first_points(sweep)) for sweep in street.sweeps[:2])
    frame = street.frames[0]
    found = LidarLabels(replace(street, sweeps=sweeps)).load(frame)
    assert found.shape == (90, 160)
    assert set(np.unique(found)) <= {0, GROUND}
