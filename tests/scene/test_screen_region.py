"""Polygons drawn on the picture, and points seen in them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.screen_region import find_points_in_region, rasterize_polygon

CAMERA = Camera(60.0, 61.0, 32.0, 24.0, 64, 48, look_at(np.array([9.0, -8.0, 3.0]), np.zeros(3)))


def winding_number(corners, x, y):
    """How often the polygon runs around a point, by summing angles."""
    offsets = corners - [x, y]
    angles = np.arctan2(offsets[:, 1], offsets[:, 0])
    turns = (np.roll(angles, -1) - angles + np.pi) % (2 * np.pi) - np.pi
    return round(turns.sum() / (2 * np.pi))


def on_outline(corners, x, y):
    """Whether a point lies on an edge: then it counts as inside or not, as the case may be."""
    ends = np.roll(corners, -1, axis=0)
    along, offset = ends - corners, np.array([x, y]) - corners
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    place = ((along * offset).sum(axis=1) / length).clip(0, 1)
    return bool((np.abs(offset - along * place[:, None]).max(axis=1) < 1e-9).any())


@given(st.lists(st.tuples(st.integers(-30, 130), st.integers(-30, 110)), min_size=3, max_size=8))
def test_mask_holds_the_pixels_that_the_outline_runs_around(corners):
    polygon = np.array(corners) / 10
    mask = rasterize_polygon(polygon, 12, 9)
    for row in range(9):
        for column in range(12):
            if on_outline(polygon, column + 0.5, row + 0.5):
                continue
            expected = winding_number(polygon, column + 0.5, row + 0.5) != 0
            assert mask[row, column] == expected, (column, row)


def test_a_rectangle_is_the_slice():
    corners = np.array([[2.2, 1.4], [7.9, 1.4], [7.9, 5.6], [2.2, 5.6]])
    expected = np.zeros((9, 12), bool)
    expected[1:6, 2:8] = True
    np.testing.assert_array_equal(rasterize_polygon(corners, 12, 9), expected)
    np.testing.assert_array_equal(rasterize_polygon(corners[::-1], 12, 9), expected)


def test_degenerate_outlines_hold_nothing_and_large_ones_all():
    for corners in (np.zeros((0, 2)), np.ones((1, 2)), np.array([[1.0, 1.0], [9.0, 5.0]])):
        assert not rasterize_polygon(corners, 12, 9).any()
    around = np.array([[-1e6, -1e6], [1e6, -1e6], [1e6, 1e6], [-1e6, 1e6]])
    assert rasterize_polygon(around, 12, 9).all()


def test_points_are_looked_up_where_the_camera_sees_them():
    rng = np.random.default_rng(0)
    points = rng.normal(0, 6, (2000, 3)).astype(np.float32)
    region = rng.random((48, 64)) < 0.5
    pixels, depth = CAMERA.project(points)
    columns, rows = np.floor(pixels).astype(int).T
    seen = (depth >= 0.1) & (columns >= 0) & (columns < 64) & (rows >= 0) & (rows < 48)
    expected = np.zeros(len(points), bool)
    expected[seen] = region[rows[seen], columns[seen]]
    assert 100 < expected.sum() < 1900
    np.testing.assert_array_equal(find_points_in_region(points, CAMERA, region, 0.1), expected)


def test_not_finite_points_and_points_behind_are_outside():
    behind = CAMERA.position - 5 * CAMERA.world_from_camera[:3, 2]
    points = np.array([[np.nan, 0, 0], [np.inf, 0, 0], behind, [0, 0, 0]], np.float32)
    inside = find_points_in_region(points, CAMERA, np.ones((48, 64), bool), 0.1)
    assert inside.tolist() == [False, False, False, True]


def test_a_region_of_another_size_is_refused():
    with pytest.raises(ValueError, match="shape"):
        find_points_in_region(np.zeros((1, 3), np.float32), CAMERA, np.ones((64, 48), bool), 0.1)
