"""Views at half the resolution, and LiDAR depth in photos."""

from dataclasses import replace

import numpy as np
import pytest
from drive import drive

from instdrive_core.masks.label_map_folder import FrameMasks
from instdrive_core.scene.camera import Camera, PhotoLag, look_at
from instdrive_core.training.views.lidar_depth import (
    MAX_LIDAR_DEPTH,
    compute_frame_depths,
    find_nearest_per_pixel,
    find_pixels_of_points,
    load_frame_depths,
    project_depths,
)
from instdrive_core.training.views.training_view import TrainingView, build_training_view


def some_view(**changes):
    frame = replace(drive().training_frames[0], **changes)
    points = drive().training_sweeps[0].load().points
    rng = np.random.default_rng(5)
    image = rng.integers(0, 256, (80, 120, 3), dtype=np.uint8)
    masks = FrameMasks(rng.integers(0, 9, (80, 120)).astype(np.uint16), rng.random((80, 120)) < 0.2)
    return build_training_view(replace(frame, load_image=lambda: image), masks, compute_frame_depths(frame, points))


def depth_map(view: TrainingView) -> np.ndarray:
    """LiDAR depth per pixel, 0 = unknown."""
    depth = np.zeros(view.image.shape[:2], np.float32)
    depth.ravel()[view.depth_pixels] = view.depth_values
    return depth


def test_nearest_depth_wins_a_pixel():
    pixels, depths = find_nearest_per_pixel(
        np.array([4, 2, 4, 2], np.int32), np.array([3.0, 9.0, 1.0, 8.0], np.float32)
    )
    assert pixels.tolist() == [2, 4]
    assert depths.tolist() == [8.0, 1.0]
    assert len(find_nearest_per_pixel(np.zeros(0, np.int32), np.zeros(0, np.float32))[0]) == 0


def test_points_fall_on_the_pixels_that_the_camera_says():
    camera = Camera(70.0, 75.0, 33.0, 21.0, 64, 40, look_at(np.array([1.0, -2.0, 1.5]), np.array([4.0, 9.0, 0.5])))
    points = np.random.default_rng(0).uniform(-15, 15, (20_000, 3)).astype(np.float32)
    places, expected = camera.project(points)
    columns, rows = np.floor(places).T
    seen = (expected > 0.5) & (columns >= 0) & (columns < 64) & (rows >= 0) & (rows < 40)
    pixels, depths = find_pixels_of_points(points, camera)
    np.testing.assert_allclose(depths, expected, atol=1e-5)
    np.testing.assert_array_equal(pixels, np.where(seen, rows * 64 + columns, -1))
    assert 500 < seen.sum() < 15_000


def test_depth_ends_where_lidar_is_too_sparse():
    camera = Camera(50.0, 50.0, 50.0, 50.0, 100, 100, np.eye(4))
    ahead = np.array([[0, 0, 0.4], [0, 0, 79], [30, 0, 81]], np.float32)
    pixels, depths = project_depths(ahead, camera)
    assert pixels.tolist() == [50 * 100 + 50]
    assert depths.tolist() == [79]
    assert MAX_LIDAR_DEPTH == 80


def test_depths_come_from_sweeps_that_may_train_and_spare_the_ego_car():
    clip = drive()
    valid = np.ones((80, 120), bool)
    valid[50:] = False
    frames = [replace(frame, valid=valid) for frame in clip.training_frames]
    found = load_frame_depths(clip, frames)
    for frame, (pixels, depths) in zip(frames, found, strict=True):
        sweep = next(sweep for sweep in clip.sweeps if sweep.index == frame.view.index)
        everywhere = dict(zip(*project_depths(sweep.load().points, frame.view.camera), strict=True))
        assert dict(zip(pixels, depths, strict=True)) == {p: d for p, d in everywhere.items() if p < 50 * 120}
        assert len(pixels) < len(everywhere)


def test_a_damaged_sweep_is_told_of_while_others_are_in_work():
    clip = drive()

    def damaged():
        raise OSError("sweep 6 is damaged")

    sweeps = (*clip.sweeps[:-1], replace(clip.sweeps[-1], load=damaged))
    with pytest.raises(OSError, match="sweep 6"):
        load_frame_depths(replace(clip, sweeps=sweeps), clip.training_frames)


def test_halving_a_view_keeps_depths_and_intrinsics():
    view = some_view()
    half = view.halve()
    assert half.image.shape == (40, 60, 3)
    assert (half.camera.fx, half.camera.cx) == (view.camera.fx / 2, view.camera.cx / 2)
    blocks = np.where(depth_map(view) > 0, depth_map(view), np.inf).reshape(40, 2, 60, 2).min(axis=(1, 3))
    np.testing.assert_array_equal(depth_map(half), np.where(np.isfinite(blocks), blocks, 0))
    np.testing.assert_array_equal(half.labels, view.labels[::2, ::2])
    lag = PhotoLag.look_from(np.zeros(3), 0.3, -0.1, -0.1, -0.05)
    assert replace(view, camera=replace(view.camera, lag=lag)).halve().camera.lag == lag


def test_a_halved_photo_is_the_mean_of_its_blocks():
    view = some_view()
    mean = view.image.reshape(40, 2, 60, 2, 3).astype(float).mean(axis=(1, 3))
    np.testing.assert_array_equal(view.halve().image, np.floor(mean + 0.5))


def test_masks_are_void_on_the_ego_car():
    valid = np.ones((80, 120), bool)
    valid[60:] = False
    view = some_view(valid=valid)
    assert not view.labels[60:].any()
    np.testing.assert_array_equal(view.labels[:60], some_view().labels[:60])
    np.testing.assert_array_equal(view.halve().valid, valid[::2, ::2])
