"""Box silhouettes agree with projected corners and stay right where corners lie behind the camera."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from instdrive_core.evaluation.metrics.box_pixels import find_box_silhouette, find_moving_box_pixels
from instdrive_core.scene.camera import Camera, PhotoLag, look_at
from instdrive_core.scene.track import Track


@pytest.fixture
def camera() -> Camera:
    return Camera(60.0, 60.0, 40.0, 30.0, 80, 60, look_at(np.array([0.0, -10.0, 0.0]), np.zeros(3)))


def test_silhouette_spans_the_projected_front_face(camera):
    silhouette = find_box_silhouette(camera, np.eye(4), np.array([4.0, 2.0, 3.0]))
    corners, _ = camera.project(np.array([[-2.0, -1, 1.5], [2.0, -1, -1.5]]))
    (left, top), (right, bottom) = corners
    rows, columns = np.nonzero(silhouette)
    # The outermost pixels are those whose centres are less than one pixel inside the projected corners.
    assert 0 <= columns.min() + 0.5 - left < 1
    assert 0 <= right - columns.max() - 0.5 < 1
    assert 0 <= rows.min() + 0.5 - top < 1
    assert 0 <= bottom - rows.max() - 0.5 < 1
    assert silhouette.sum() == len(np.unique(rows)) * len(np.unique(columns)), "seen face on it is a rectangle"


def test_boxes_around_and_behind_the_camera(camera):
    around, behind = np.eye(4), np.eye(4)
    around[:3, 3] = camera.position
    behind[:3, 3] = [0, -30, 0]
    assert find_box_silhouette(camera, around, np.full(3, 2.0)).all()
    assert not find_box_silhouette(camera, behind, np.full(3, 2.0)).any()


@pytest.mark.parametrize("seed", range(20))
def test_silhouette_holds_every_point_of_the_box_in_view(seed):
    rng = np.random.default_rng(seed)
    at, target = rng.uniform(-6, 6, 3), rng.uniform(-3, 3, 3)
    camera = Camera(60.0, 50.0, 37.0, 33.0, 80, 60, look_at(at, target))
    box = look_at(rng.uniform(-3, 3, 3), rng.uniform(-3, 3, 3))
    size = rng.uniform(0.5, 8, 3)
    points = rng.uniform(-0.5, 0.5, (4000, 3)) * size @ box[:3, :3].T + box[:3, 3]
    pixels, depths = camera.project(points)
    seen = (depths > 0) & (pixels >= 0).all(axis=1) & (pixels < [80, 60]).all(axis=1)
    columns, rows = np.floor(pixels[seen]).astype(int).T
    grown = binary_dilation(find_box_silhouette(camera, box, size), np.ones((3, 3)))
    assert grown[rows, columns].all()


def test_only_moving_boxes_that_exist_count(camera):
    poses = np.stack([np.eye(4)] * 2)
    parked = Track("a", "car", np.full(3, 2.0), np.array([0.0, 1.0]), poses, moving=False)
    driving = Track("b", "car", np.full(3, 2.0), np.array([0.0, 1.0]), poses, moving=True)
    assert not find_moving_box_pixels(camera, [parked], 0.5).any()
    assert find_moving_box_pixels(camera, [parked, driving], 0.5).any()
    assert not find_moving_box_pixels(camera, [parked, driving], 3.0).any()


def test_boxes_are_where_the_photo_shows_them():
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [-20.0, 0.0, 20.0]
    track = Track("a", "car", np.full(3, 2.0), np.array([0.0, 1.0, 2.0]), poses, moving=True)
    camera = Camera(60.0, 60.0, 40.0, 30.0, 80, 60, look_at(np.array([0.0, -10.0, 0.0]), np.zeros(3)))
    lag = PhotoLag.look_from(np.zeros(3), 0.0, 2.0, 0.0, -0.5)
    taken_earlier = replace(camera, lag=replace(lag, taken=-1.0))
    assert lag.find(track.interpolate_position(2.0)) == pytest.approx(-0.5)
    assert not find_moving_box_pixels(camera, [track], 2.0).any()
    seen = find_moving_box_pixels(taken_earlier, [track], 2.0)
    np.testing.assert_array_equal(seen, find_moving_box_pixels(camera, [track], 1.0))
    assert seen.any()
