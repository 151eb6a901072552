"""The first Gaussians and the names of instances, on a drive in memory."""

from dataclasses import replace

import numpy as np
import pytest
from drive import SIZE, drive

from instdrive_core.errors import DataError
from instdrive_core.scene.track import points_inside
from instdrive_core.training.config import InitConfig
from instdrive_core.training.initialize import initial_scene
from instdrive_core.training.naming import display_names, instance_classes
from instdrive_core.training.views import nearest_per_pixel, training_view

CONFIG = InitConfig(lidar_points=2000, near_points=50, far_points=50, actor_points=300)


def views_of(clip):
    sweeps = {sweep.index: sweep.load().points for sweep in clip.sweeps}
    return [training_view(frame, sweeps[frame.view.index], None, None) for frame in clip.training_frames()]


def test_moving_objects_leave_the_background_and_gather_in_their_box():
    clip = drive()
    start = initial_scene(clip, views_of(clip), CONFIG, sh_degree=1, seed=0)
    assert [actor.id for actor in start.actors] == ["moving"]
    assert np.all(np.diff(start.nodes.astype(int)) >= 0)
    local = start.gaussians.means[start.nodes == 1]
    assert 200 <= len(local) <= CONFIG.actor_points
    assert np.all(np.abs(local) <= SIZE / 2 + 0.2)
    moving = clip.tracks[0]
    background = start.gaussians.means[start.nodes == 0]
    for sweep in clip.training_sweeps():
        inside = points_inside(background, moving.pose_at(sweep.time), SIZE, margin=-0.1, bottom=-0.1)
        at_that_time = np.isin(background[:, 0], sweep.load().points[3000:3400, 0])
        assert not np.any(inside & at_that_time)


def test_thinning_respects_the_limit_and_is_deterministic():
    clip = drive()
    first = initial_scene(clip, views_of(clip), CONFIG, 0, seed=1)
    again = initial_scene(clip, views_of(clip), CONFIG, 0, seed=1)
    other = initial_scene(clip, views_of(clip), CONFIG, 0, seed=2)
    assert (first.nodes == 0).sum() <= CONFIG.lidar_points + CONFIG.near_points + CONFIG.far_points + 10
    np.testing.assert_array_equal(first.gaussians.means, again.gaussians.means)
    assert first.gaussians.means.shape != other.gaussians.means.shape or not np.array_equal(
        first.gaussians.means, other.gaussians.means
    )


def test_held_out_sweeps_place_nothing():
    clip = drive()
    held_out = next(sweep for sweep in clip.sweeps if sweep.index == 4).load().points
    start = initial_scene(clip, views_of(clip), replace(CONFIG, lidar_points=10**6), 0, 0)
    background = start.gaussians.means[start.nodes == 0]
    assert not np.isin(held_out[:3000, 0], background[:, 0]).any()


def test_a_clip_whose_lidar_no_camera_sees_is_refused():
    clip = drive()
    with pytest.raises(DataError, match="no LiDAR point"):
        initial_scene(replace(clip, sweeps=()), views_of(clip), CONFIG, 0, 0)


def test_nearest_depth_wins_a_pixel():
    pixels, depths = nearest_per_pixel(np.array([4, 2, 4, 2], np.int32), np.array([3.0, 9.0, 1.0, 8.0], np.float32))
    assert pixels.tolist() == [2, 4]
    assert depths.tolist() == [8.0, 1.0]


def test_halving_a_view_keeps_depths_and_intrinsics():
    clip = drive()
    view = views_of(clip)[0]
    half = view.halved()
    assert half.image.shape == (40, 60, 3)
    assert (half.camera.fx, half.camera.cx) == (view.camera.fx / 2, view.camera.cx / 2)
    blocks = np.where(view.depth_map() > 0, view.depth_map(), np.inf).reshape(40, 2, 60, 2).min(axis=(1, 3))
    np.testing.assert_array_equal(half.depth_map(), np.where(np.isfinite(blocks), blocks, 0))


def test_instances_are_named_by_track_parked_box_and_lidar():
    clip = drive()
    start = initial_scene(clip, views_of(clip), CONFIG, 0, 0)
    means, nodes = start.gaussians.means, start.nodes
    parked = points_inside(means, clip.tracks[1].world_from_box[0], SIZE, 0.05, bottom=-0.02) & (nodes == 0)
    ids = np.where(nodes == 1, 3, np.where(parked, 2, 1)).astype(np.uint32)
    classes = instance_classes(clip, ids, means, nodes, ["Pickup Truck"])
    assert classes == {1: "Road", 2: "Car", 3: "Pickup Truck"}
    assert display_names(ids, {1: "Road"}) == {1: "Road 1", 2: "instance 2", 3: "instance 3"}
