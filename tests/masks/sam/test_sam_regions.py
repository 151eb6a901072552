"""What becomes of the masks that Segment Anything proposes: parts, wholes, doubles, crumbs."""

import numpy as np

from instdrive_core.masks.sam.regions import Regions, clean_regions, merge_parts, paint_regions, select_distinct


def box(top, bottom, left, right, shape=(20, 40)):
    """A mask that fills a rectangle."""
    mask = np.zeros(shape, bool)
    mask[top:bottom, left:right] = True
    return mask


def regions(*masks, scores=None):
    return Regions(np.array(masks), np.array(scores if scores else [0.9] * len(masks), np.float32))


CAR, WHEEL, DOOR, HUB = box(5, 15, 5, 20), box(11, 15, 6, 10), box(6, 13, 11, 16), box(12, 14, 7, 9)


def assert_masks(found, *expected):
    assert sorted(mask.tobytes() for mask in found.masks) == sorted(mask.tobytes() for mask in expected)


def test_parts_join_the_whole_and_so_do_their_parts():
    assert_masks(merge_parts(regions(WHEEL, CAR, HUB, DOOR), 0.85), CAR)


def test_what_pokes_out_of_the_whole_belongs_to_it():
    wheel = box(11, 16, 6, 10)  # the lowest of its 5 rows is outside
    assert_masks(merge_parts(regions(wheel, CAR), 0.75), CAR | wheel)
    assert_masks(merge_parts(regions(wheel, CAR), 0.85), CAR, wheel)


def test_a_whole_that_the_model_trusts_less_takes_nothing_in():
    assert_masks(merge_parts(regions(WHEEL, CAR, scores=[0.98, 0.9]), 0.85), WHEEL, CAR)
    assert_masks(merge_parts(regions(WHEEL, CAR, scores=[0.94, 0.9]), 0.85), CAR)


def test_a_mask_of_the_scene_is_no_whole():
    scene = box(2, 20, 0, 40)
    assert_masks(merge_parts(regions(CAR, scene), 0.85), CAR, scene)


def test_a_row_of_cars_is_several_unless_the_model_trusts_the_row_more():
    left, right = box(5, 15, 5, 15), box(5, 15, 15, 25)
    row, almost = left | right, (left | right) & ~box(5, 6, 5, 8)
    assert_masks(merge_parts(regions(left, right, row, almost, scores=[0.95, 0.95, 0.92, 0.92]), 0.85), left, right)
    assert_masks(merge_parts(regions(left, right, row, scores=[0.92, 0.92, 0.95]), 0.85), row)


def test_an_object_with_a_main_part_is_no_group():
    body, windows = box(8, 15, 5, 20), box(5, 8, 5, 20)
    assert_masks(merge_parts(regions(body, windows, CAR, scores=[0.92, 0.92, 0.9]), 0.85), CAR)


def test_two_objects_that_overlap_a_little_stay_two():
    left, right = box(5, 15, 5, 15), box(5, 15, 13, 25)
    assert_masks(merge_parts(regions(left, right), 0.85), left, right)


def test_of_duplicates_the_best_is_kept_or_the_fuller_one_where_wholes_are_wanted():
    boxes = np.array([[0, 0, 10, 10], [0, 0, 10, 10], [0, 0, 10, 8], [20, 0, 30, 10]], np.float32)
    areas, scores = np.array([70, 95, 80, 60]), np.array([0.93, 0.91, 0.8, 0.92], np.float32)
    assert select_distinct(boxes, areas, scores, 0.7, prefer_large=False).tolist() == [0, 3]
    assert select_distinct(boxes, areas, scores, 0.7, prefer_large=True).tolist() == [1, 3]
    worse = np.array([0.97, 0.91, 0.8, 0.92], np.float32)
    assert select_distinct(boxes, areas, worse, 0.7, prefer_large=True).tolist() == [0, 3]
    assert select_distinct(boxes, areas, scores, 1.0, prefer_large=False).tolist() == [0, 3, 1, 2]


def test_holes_and_islands_go_and_so_does_what_lies_on_the_ego_vehicle():
    holed = CAR & ~box(7, 9, 7, 9)
    island = box(0, 1, 35, 38)
    hood, straddling = box(15, 20, 25, 35), box(10, 17, 25, 35)
    valid = ~box(15, 20, 0, 40)
    found = clean_regions(regions(holed | island, hood, straddling, island, scores=[0.9, 0.8, 0.7, 0.6]), valid, 5)
    assert_masks(found, CAR, box(10, 15, 25, 35))
    np.testing.assert_allclose(found.scores, [0.9, 0.7])
    large_hole = CAR & ~box(7, 10, 7, 9)
    assert_masks(clean_regions(regions(large_hole), valid, 5), large_hole)


def test_small_is_painted_over_large_and_crumbs_are_nobodys():
    road, wheel = box(4, 16, 4, 21), box(15, 19, 6, 10)
    labels = paint_regions(regions(wheel, road, CAR), 10)
    expected = np.zeros((20, 40), np.uint32)
    expected[road] = 2
    expected[CAR] = 3
    expected[wheel] = 1
    np.testing.assert_array_equal(labels, expected)
    labels = paint_regions(regions(wheel, road, CAR), 60)
    assert set(np.unique(labels)) == {0, 3}, "a rim of 54 pixels and a wheel of 16 are crumbs"


def test_no_masks_at_all_are_fine():
    nothing = Regions(np.zeros((0, 20, 40), bool), np.zeros(0, np.float32))
    assert len(clean_regions(nothing, np.ones((20, 40), bool), 3)) == len(merge_parts(nothing, 0.85)) == 0
    assert not paint_regions(nothing, 3).any()
    boxes = np.zeros((0, 4), np.float32)
    assert len(select_distinct(boxes, np.zeros(0, np.int64), np.zeros(0, np.float32), 0.7, prefer_large=True)) == 0
