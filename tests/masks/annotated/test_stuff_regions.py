"""Stuff in parts and regions: what hangs together in space, in one photo, and in most of them."""

import numpy as np
import pytest

from instdrive_core.masks.annotated.part_maps import PartPixels, build_part_map
from instdrive_core.masks.annotated.stuff_parts import CELL, split_stuff
from instdrive_core.masks.annotated.stuff_regions import merge_into_regions

BUILDING, ROAD = 2, 5


def wall(x: float, start: float, end: float) -> np.ndarray:
    """Points of a facade along y, 0.2 m apart."""
    y, z = np.meshgrid(np.arange(start, end, 0.2), np.arange(0, 4, 0.2))
    return np.stack([np.full(y.size, x), y.ravel(), z.ravel()], -1).astype(np.float32)


def split(*walls: np.ndarray, labels=None):
    labels = [BUILDING] * len(walls) if labels is None else labels
    ids = np.repeat(labels, [len(each) for each in walls]).astype(np.uint32)
    return split_stuff(np.concatenate(walls), ids)


def test_both_sides_of_the_street_are_two_parts():
    left, right = wall(-10, 0, 20), wall(10, 0, 20)
    found = split(left, right)
    assert found.label_of_part.tolist() == [0, BUILDING, BUILDING]
    assert len(set(found.parts[: len(left)])) == len(set(found.parts[len(left) :])) == 1
    assert found.parts[0] != found.parts[-1]


def test_labels_are_never_one_part_and_unknown_is_none():
    found = split(wall(0, 0, 5), wall(0.1, 0, 5), wall(0.2, 0, 5), labels=[BUILDING, ROAD, 0])
    assert sorted(found.label_of_part.tolist()) == [0, BUILDING, ROAD]
    assert (found.label_of_part[found.parts] == np.repeat([BUILDING, ROAD, 0], len(wall(0, 0, 5)))).all()


def test_a_few_points_join_the_nearest_part_of_their_label_but_not_from_afar():
    near, far = np.array([[0, 20.0 + 2 * CELL, 2]], np.float32), np.array([[0, 60, 2]], np.float32)
    found = split(wall(0, 0, 20), near, far)
    assert found.parts[-2] == found.parts[0] != found.parts[-1]


def test_other_points_are_looked_up_by_place_and_label():
    found = split(wall(-10.5, 0, 20), wall(10.5, 0, 20))
    asked = np.array([[-10.52, 5, 1], [10.52, 5, 1], [10.52, 5, 1], [0, 5, 1]], np.float32)
    parts = found.find_parts(asked, np.array([BUILDING, BUILDING, ROAD, BUILDING]))
    assert parts.tolist() == [found.parts[0], found.parts[-1], 0, 0]
    nothing = split_stuff(np.zeros((0, 3), np.float32), np.zeros(0, np.uint32))
    assert not nothing.find_parts(asked, np.full(4, BUILDING)).any()


def test_pixels_take_the_nearest_part_within_their_region():
    labels = np.full((6, 12), BUILDING, np.int32)
    labels[:, 5:7] = ROAD
    drawn = np.zeros((6, 12), np.uint32)
    drawn[2, 0], drawn[2, 11], drawn[3, 6] = 1, 2, 3
    drawn[0, 5] = 1  # a point that the map says is not there
    found = build_part_map(labels, drawn, np.array([0, BUILDING, BUILDING, ROAD], np.uint32))
    assert (found.parts[:, :5] == 1).all()
    assert (found.parts[:, 7:] == 2).all()
    assert (found.parts[:, 5:7] == 3).all()
    assert found.join_regions(4).tolist() == [0, 1, 2, 3]


def test_parts_of_one_region_are_joined_in_a_photo():
    labels = np.full((4, 10), BUILDING, np.int32)
    drawn = np.zeros((4, 10), np.uint32)
    drawn[1, 1], drawn[1, 8] = 1, 2
    found = build_part_map(labels, drawn, np.array([0, BUILDING, BUILDING], np.uint32))
    assert set(np.unique(found.parts)) == {1, 2}
    assert found.join_regions(3).tolist() == [0, 1, 1]


def photo(*regions: dict[int, int]) -> PartPixels:
    """A photo by its regions: part → pixels."""
    entries = [(number, part, area) for number, region in enumerate(regions) for part, area in region.items()]
    columns = zip(*entries, strict=True)
    return PartPixels(*(np.array(column, np.int64) for column in columns))


@pytest.mark.parametrize(
    ("photos", "expected"),
    [
        ([photo({1: 500, 2: 500})], [1, 1]),
        ([photo({1: 500}, {2: 500})], [1, 2]),
        ([photo({1: 500, 2: 500}), photo({1: 500}, {2: 500}), photo({1: 400}, {2: 400})], [1, 2]),
        ([photo({1: 500, 2: 500}), photo({1: 500, 2: 600}), photo({1: 400}, {2: 400})], [1, 1]),
        ([photo({1: 500}), photo({2: 500})], [1, 2]),
    ],
    ids=["together", "apart", "mostly apart", "mostly together", "never in one photo"],
)
def test_parts_are_one_where_most_photos_say_so(photos, expected):
    assert merge_into_regions(photos, np.array([0, BUILDING, BUILDING], np.uint32)).tolist() == [0, *expected]


def test_what_meets_far_away_in_one_photo_joins_no_two_sides():
    """Left (1) and right (2) meet through what lies far away (3), which only one photo shows."""
    apart = photo({1: 900}, {2: 900})
    meeting = photo({1: 900, 2: 900, 3: 100})
    regions = merge_into_regions([apart, apart, meeting], np.array([0, *[BUILDING] * 3], np.uint32))
    assert regions[1] != regions[2]


def test_near_and_far_join_through_what_lies_between():
    photos = [photo({1: 500, 2: 300}), photo({2: 400, 3: 500})]
    assert merge_into_regions(photos, np.array([0, *[BUILDING] * 3], np.uint32)).tolist() == [0, 1, 1, 1]


def test_labels_never_merge():
    assert merge_into_regions([photo({1: 500}, {2: 500})], np.array([0, BUILDING, ROAD], np.uint32)).tolist() == [
        0,
        1,
        2,
    ]
