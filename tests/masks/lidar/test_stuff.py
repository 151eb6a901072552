"""Facades, walls, plants and the backdrop apart; cars of a queue apart; pieces that photos show as one."""

import numpy as np
import pytest

from instdrive_core.masks.annotated.stuff_regions import merge_into_regions
from instdrive_core.masks.lidar.cluster_kind import (
    BACKDROP,
    FACADE,
    GROUND,
    NONE,
    THING,
    VEGETATION,
    WALL,
    classify_clusters,
)
from instdrive_core.masks.lidar.cluster_parts import part_queues
from instdrive_core.masks.lidar.point_shape import PointShape
from instdrive_core.masks.lidar.stuff_pixels import count_stuff_pixels
from instdrive_core.masks.lidar.walls import join_wide, part_walls, recognize_stuff

ASIDE = np.array([40, 0, 0], np.float32)


def box(low, high, count, seed=0):
    return np.random.default_rng(seed).uniform(low, high, (count, 3)).astype(np.float32)


def cluster(*parts):
    return np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts]).astype(np.int32)


def part(points, ceiling):
    clusters, kinds = np.zeros(len(points), np.int32), np.array([FACADE], np.uint32)
    return part_walls(points, clusters, kinds, points[:, 2], np.full(len(points), ceiling, np.float32))


def test_a_fence_that_begins_at_a_house_is_no_part_of_its_facade():
    house, fence = box([0, 0, 0], [10, 0.1, 6], 6000), box([10, 0, 0], [22, 0.1, 2], 3000)
    porch = box([-2, 0, 0], [0, 0.1, 2.5], 500)
    clusters, kinds = part(np.concatenate([house, fence, porch]), 9.0)
    assert kinds.tolist() == [FACADE, WALL]
    assert (clusters[:6000] == 0).all()
    far_from_house = fence[:, 0] > 12
    assert (clusters[6000:9000][far_from_house] == 1).all()
    assert (clusters[9000:] == 0).all(), "a short low piece stays with the house"


def test_what_goes_on_above_the_highest_beam_may_be_a_house():
    low = box([0, 0, 0], [12, 0.1, 2], 3000)
    assert part(low, 2.1)[1].tolist() == [FACADE]
    assert part(low, 3.0)[1].tolist() == [FACADE, WALL]


def test_cars_bumper_to_bumper_are_parted_and_a_lorry_is_not():
    def car(x):
        return np.concatenate(
            [box([x, 0, 0.2], [x + 4.2, 1.8, 0.9], 800), box([x + 1, 0, 0.9], [x + 3.5, 1.7, 1.5], 400)]
        )

    bumpers = [box([x - 0.4, 0.8, 0.3], [x, 1.0, 0.5], 20) for x in (4.6, 9.2)]
    lorry = box([0, 20, 0.2], [9, 22, 2.5], 2000)
    hedge = box([0, 30, 0], [9, 31, 1.2], 2000)
    queue = np.concatenate([car(0), car(4.6), car(9.2), *bumpers])
    turned = queue @ np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]], np.float32)
    points, clusters = cluster(turned, lorry + ASIDE, hedge + ASIDE)
    parted = part_queues(points, clusters, points[:, 2])
    numbers = [np.bincount(parted[start : start + 1200]).argmax() for start in (0, 1200, 2400)]
    assert len(set(numbers)) == 3
    assert all((parted[1200 * n : 1200 * n + 1200] == number).mean() > 0.97 for n, number in enumerate(numbers))
    assert len(np.unique(parted[clusters == 1])) == len(np.unique(parted[clusters == 2])) == 1
    assert part_queues(points[:0], clusters[:0], points[:0, 2]).tolist() == []


def test_a_car_of_scattered_points_is_a_thing_and_a_long_hedge_a_wall():
    parts = (
        box([0, 0, 0.3], [2.0, 1.7, 1.3], 300),
        box([0, 10, 0.3], [2.0, 11.7, 3.0], 300),
        box([0, 20, 0.2], [9, 21, 1.6], 900),
        box([0, 30, 1.1], [2, 31, 2.0], 300),
    )
    points, clusters = cluster(*parts)
    scattered = PointShape(np.full(len(points), 0.6, np.float32), np.zeros(len(points), np.float32))
    kinds = classify_clusters(points, clusters, scattered, points[:, 2])
    assert kinds.tolist() == [THING, VEGETATION, WALL, VEGETATION]


def test_what_stands_around_tells_what_a_cluster_is():
    fence, bars = box([0, 0, 0.2], [8, 0.1, 1], 400), box([0, 0, 1], [8, 0.1, 2.2], 400)
    shrub = box([0, 6, 1], [4, 8, 2.4], 400)
    near_post, far_post = box([4, 12, 0.2], [4.3, 12.3, 3.5], 100), box([40, 0, 0.2], [40.3, 0.3, 3.5], 100)
    far_car, house = box([40, 9, 0.2], [44, 10.8, 1.5], 200), box([80, 0, 0], [95, 1, 7], 900)
    points, clusters = cluster(fence, bars, shrub, near_post, far_post, far_car, house)
    kinds = np.array([WALL, VEGETATION, VEGETATION, THING, THING, THING, FACADE], np.uint32)
    found = recognize_stuff(points, clusters, kinds, points[:, 2], points[:, 0], posts_apart=False)
    assert found.tolist() == [WALL, WALL, VEGETATION, THING, WALL, THING, BACKDROP]
    found = recognize_stuff(points, clusters, kinds, points[:, 2], points[:, 0], posts_apart=True)
    assert found.tolist() == [WALL, WALL, VEGETATION, THING, THING, THING, BACKDROP]


def test_only_pieces_of_one_kind_join():
    house, fence = box([0, 0, 0], [8, 0.1, 6], 900), box([8, 0, 0], [16, 0.1, 2], 900)
    crowns = [box([x, 3, 2], [x + 2, 5, 5], 400) for x in (0, 2.6, 9)]
    points, clusters = cluster(house, fence, *crowns)
    kinds = np.array([FACADE, WALL, VEGETATION, VEGETATION, VEGETATION], np.uint32)
    joined = join_wide(points, clusters, kinds, np.full(len(points), 10, np.float32))
    assert [np.unique(joined[clusters == number]).tolist() for number in range(5)] == [[0], [1], [2], [2], [4]]


@pytest.mark.parametrize(("apart", "regions"), [(1, [0, 1, 2, 2, 4, 5]), (3, [0, 1, 2, 3, 4, 5])])
def test_plants_that_most_photos_show_as_one_are_one_and_houses_are_not(apart, regions):
    kinds = np.array([NONE, GROUND, VEGETATION, VEGETATION, FACADE, FACADE], np.uint32)
    touching, parted = np.ones((20, 30), np.int32), np.ones((20, 30), np.int32)
    touching[2:8, 2:8], touching[2:8, 8:14], touching[2:8, 14:20] = 2, 3, 4
    touching[2:8, 20:26] = 5  # the house next door stays another one
    parted[2:8, 2:8], parted[2:8, 10:16], parted[:, 28:] = 2, 3, -1
    parted[15:18, 2:8] = 9  # a thing: has no kind among the wide ones
    photos = [count_stuff_pixels(touching, kinds), *[count_stuff_pixels(parted, kinds)] * (apart - 1)]
    if apart == 1:
        photos.append(count_stuff_pixels(touching, kinds))
    assert merge_into_regions(photos, kinds).tolist() == regions
    assert count_stuff_pixels(np.full((4, 4), 9, np.int32), kinds).parts.tolist() == []
