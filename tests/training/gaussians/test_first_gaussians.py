"""The first Gaussians and the names of instances, on a drive in memory."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from drive import SIZE, drive

from instdrive_core.errors import DataError
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.track import find_points_inside
from instdrive_core.training.gaussians.first_gaussians import (
    build_initial_scene,
    compute_mean_sky_color,
    compute_scene_radius,
)
from instdrive_core.training.instances.naming import find_instance_classes, make_display_names
from instdrive_core.training.settings.config import InitConfig
from instdrive_core.training.views.view_store import ViewStore, open_view_store

CONFIG = InitConfig(lidar_points=2000, near_points=50, far_points=50, actor_points=300)


def views_of(clip):
    return open_view_store(clip, None)


def test_moving_objects_leave_the_background_and_gather_in_their_box():
    clip = drive()
    start = build_initial_scene(clip, views_of(clip), CONFIG, sh_degree=1, seed=0)
    assert [actor.id for actor in start.actors] == ["moving"]
    assert np.all(np.diff(start.nodes.astype(int)) >= 0)
    local = start.gaussians.means[start.nodes == 1]
    assert (local[:, 2] < 0.1 - SIZE[2] / 2).any()
    local = local[local[:, 2] > 0.1 - SIZE[2] / 2]  # without its shadow
    assert 200 <= len(local) <= CONFIG.actor_points
    assert np.all(np.abs(local) <= SIZE / 2 + 0.2)
    moving = clip.tracks[0]
    background = start.gaussians.means[start.nodes == 0]
    for sweep in clip.training_sweeps:
        inside = find_points_inside(background, moving.interpolate_pose(sweep.time), SIZE, margin=-0.1, bottom=-0.1)
        at_that_time = np.isin(background[:, 0], sweep.load().points[3000:3400, 0])
        assert not np.any(inside & at_that_time)


def test_thinning_respects_the_limit_and_is_deterministic():
    clip = drive()
    first = build_initial_scene(clip, views_of(clip), CONFIG, 0, seed=1)
    again = build_initial_scene(clip, views_of(clip), CONFIG, 0, seed=1)
    other = build_initial_scene(clip, views_of(clip), CONFIG, 0, seed=2)
    assert (first.nodes == 0).sum() <= CONFIG.lidar_points + CONFIG.near_points + CONFIG.far_points + 10
    np.testing.assert_array_equal(first.gaussians.means, again.gaussians.means)
    assert first.gaussians.means.shape != other.gaussians.means.shape or not np.array_equal(
        first.gaussians.means, other.gaussians.means
    )


def test_held_out_sweeps_place_nothing():
    clip = drive()
    held_out = next(sweep for sweep in clip.sweeps if sweep.index == 4).load().points
    start = build_initial_scene(clip, views_of(clip), replace(CONFIG, lidar_points=10**6), 0, 0)
    background = start.gaussians.means[start.nodes == 0]
    assert not np.isin(held_out[:3000, 0], background[:, 0]).any()


def test_a_clip_whose_lidar_no_camera_sees_is_refused():
    clip = drive()
    away = tuple(
        replace(sweep, load=lambda sweep=sweep: replace(sweep.load(), points=-sweep.load().points))
        for sweep in clip.sweeps
    )
    with pytest.raises(DataError, match="no camera sees a LiDAR point"):
        build_initial_scene(replace(clip, sweeps=away), views_of(clip), CONFIG, 0, 0)


def test_no_views_and_no_sweeps_are_told_apart():
    clip = drive()
    with pytest.raises(DataError, match="no photo of a training time step"):
        build_initial_scene(clip, ViewStore.from_views([]), CONFIG, 0, 0)
    only_held_out = tuple(sweep for sweep in clip.sweeps if sweep.index == 4)
    with pytest.raises(DataError, match=r"no LiDAR sweep of a training time step \(lidar/"):
        build_initial_scene(replace(clip, sweeps=only_held_out), views_of(clip), CONFIG, 0, 0)


def test_without_moving_actors_their_points_stay_in_the_background():
    clip = drive()
    many = replace(CONFIG, lidar_points=10**6)
    static = build_initial_scene(clip, views_of(clip), many, 0, 0, moving_actors=False)
    assert static.actors == ()
    assert not static.nodes.any()
    moving, step = clip.tracks[0], clip.training_sweeps[1]
    inside = find_points_inside(static.gaussians.means, moving.interpolate_pose(step.time), SIZE, bottom=-0.1)
    assert inside.sum() > 200
    with_actors = build_initial_scene(clip, views_of(clip), many, 0, 0)
    assert (with_actors.nodes == 0).sum() < len(static.nodes)


def test_a_clip_without_cuboids_is_static():
    clip = drive()
    bare = build_initial_scene(replace(clip, tracks=()), views_of(clip), CONFIG, 0, 0)
    static = build_initial_scene(clip, views_of(clip), CONFIG, 0, 0, moving_actors=False)
    assert bare.actors == ()
    np.testing.assert_array_equal(bare.gaussians.means, static.gaussians.means)


def test_one_time_step_is_enough():
    clip = drive()
    one = replace(
        clip,
        frames=clip.frames[:1],
        sweeps=clip.sweeps[:1],
        tracks=tuple(replace(t, moving=False) for t in clip.tracks),
    )
    start = build_initial_scene(one, views_of(one), CONFIG, 3, 0)
    assert len(start.gaussians.means) > 500
    assert start.gaussians.sh_rest.shape[1:] == (15, 3)
    assert np.isfinite(start.gaussians.log_scales).all()
    assert compute_scene_radius(views_of(one)) == 10.0


def test_an_object_hit_by_few_points_stays_out():
    clip = drive()
    poses = clip.tracks[0].world_from_box.copy()
    poses[:, 0, 3] -= 4.9
    far = replace(clip.tracks[0], world_from_box=poses)
    assert build_initial_scene(replace(clip, tracks=(far,)), views_of(clip), CONFIG, 0, 0).actors == ()


def test_colours_are_those_of_the_photos():
    clip = drive()
    half = np.zeros((80, 120, 3), np.uint8)
    half[:, 60:] = 255
    clip = replace(clip, frames=tuple(replace(frame, load_image=lambda: half) for frame in clip.frames), tracks=())
    start = build_initial_scene(clip, views_of(clip), replace(CONFIG, near_points=0, far_points=0), 0, 0)
    colors = color_from_dc(start.gaussians.sh_dc)
    right = start.gaussians.means[:, 0] > 0.2
    np.testing.assert_allclose(colors[right], 1, atol=1e-5)
    np.testing.assert_allclose(colors[start.gaussians.means[:, 0] < -0.2], 0, atol=1e-5)
    assert 0.2 < right.mean() < 0.8


def test_what_no_camera_sees_is_not_in_the_background():
    clip = drive()
    valid = np.zeros((80, 120), bool)
    valid[:, :60] = True
    frames = tuple(replace(frame, valid=valid) for frame in clip.frames)
    start = build_initial_scene(
        replace(clip, frames=frames, tracks=()), views_of(replace(clip, frames=frames)), CONFIG, 0, 0
    )
    assert start.gaussians.means[:, 0].max() < 0.1


def test_points_beyond_lidar_keep_off_sky_and_lie_as_deep_as_asked():
    clip = drive()
    sky = np.zeros((80, 120), bool)
    sky[:20] = True
    views = [replace(views_of(clip).get(number), sky=sky) for number in range(3)]
    config = replace(CONFIG, lidar_points=1, near_points=3_000, far_points=3_000)
    means = build_initial_scene(replace(clip, tracks=()), ViewStore.from_views(views), config, 0, 0).gaussians.means[1:]
    near, far = means[: len(means) // 2], means[len(means) // 2 :]
    assert len(near) == len(far) > 1_000
    camera = views[0].camera
    for points in (near, far):
        pixels, depths = camera.project(points)
        assert depths.min() > 0.5
        assert pixels[:, 1].min() >= 20
    assert np.median(camera.project(far)[1]) > 1.4 * np.median(camera.project(near)[1])


def test_the_budget_of_the_store_changes_nothing():
    clip = drive()
    views = [views_of(clip).get(number) for number in range(3)]
    starts = [
        build_initial_scene(clip, ViewStore.from_views(views, budget), CONFIG, 1, seed=4) for budget in (0, 10**9)
    ]
    np.testing.assert_array_equal(starts[0].gaussians.means, starts[1].gaussians.means)
    np.testing.assert_array_equal(starts[0].nodes, starts[1].nodes)


def test_the_number_of_threads_changes_nothing():
    clip, threads = drive(), numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = build_initial_scene(clip, views_of(clip), CONFIG, 1, seed=4)
    finally:
        numba.set_num_threads(threads)
    together = build_initial_scene(clip, views_of(clip), CONFIG, 1, seed=4)
    np.testing.assert_array_equal(alone.gaussians.means, together.gaussians.means)
    np.testing.assert_array_equal(alone.gaussians.log_scales, together.gaussians.log_scales)
    np.testing.assert_array_equal(alone.gaussians.sh_dc, together.gaussians.sh_dc)


def test_a_sweep_without_photos_still_shapes_moving_objects():
    clip = drive()
    dark = replace(clip, frames=tuple(frame for frame in clip.frames if frame.view.index != 5))
    start = build_initial_scene(dark, views_of(dark), replace(CONFIG, actor_points=10**5), 0, 0)
    everywhere = build_initial_scene(clip, views_of(clip), replace(CONFIG, actor_points=10**5), 0, 0)
    assert (start.nodes == 1).sum() == (everywhere.nodes == 1).sum()
    grey = np.all(start.gaussians.sh_dc[start.nodes == 1] == 0, axis=1)
    assert 0.2 < grey.mean() < 0.5


def test_each_photo_is_read_once():
    clip = drive()
    views, read = views_of(clip), []

    def watched(number):
        read.append(number)
        return views.get(number)

    build_initial_scene(clip, ViewStore(views.facts, watched, budget_bytes=0), CONFIG, 0, 0)
    assert sorted(read) == [0, 1, 2]


def test_large_photos_are_looked_at_in_blocks():
    """Half as many pixels along each side, the same points in the world, up to a block."""
    clip = drive()
    camera = clip.frames[0].view.camera.scale(10.0)
    frames = tuple(
        replace(frame, view=replace(frame.view, camera=camera), load_image=lambda: np.full((800, 1200, 3), 9, np.uint8))
        for frame in clip.frames
    )
    config = replace(CONFIG, lidar_points=1, near_points=900, far_points=0)
    large = build_initial_scene(
        replace(clip, frames=frames, tracks=()), views_of(replace(clip, frames=frames)), config, 0, 0
    ).gaussians.means[1:]
    small = build_initial_scene(replace(clip, tracks=()), views_of(clip), config, 0, 0).gaussians.means[1:]
    assert len(large) == 900
    pixels, _ = camera.project(large)
    np.testing.assert_allclose(pixels % 2, 1.5, atol=0.05)
    np.testing.assert_allclose(np.median(large, axis=0), np.median(small, axis=0), atol=2.0)


def test_the_scenes_radius_spans_the_cameras():
    view = views_of(drive()).get(0)

    def at(x):
        pose = view.camera.world_from_camera.copy()
        pose[0, 3] = x
        return replace(view, camera=replace(view.camera, world_from_camera=pose))

    assert compute_scene_radius(ViewStore.from_views([at(0.0), at(60.0)])) == pytest.approx(30)
    assert compute_scene_radius(ViewStore.from_views([at(0.0), at(1.0)])) == 10
    apart = [replace(at(2.0 * step), key=f"front/{step:02d}") for step in range(100)]
    assert compute_scene_radius(ViewStore.from_views(apart)) == pytest.approx(29), "of 30 steps, however long the way"


def test_the_skys_colour_is_the_mean_over_its_masks():
    view = views_of(drive()).get(0)
    image = np.zeros((80, 120, 3), np.uint8)
    image[:40] = (51, 102, 204)
    sky = np.zeros((80, 120), bool)
    sky[:40] = True
    views = [replace(view, image=image, sky=sky)] * 70 + [view]
    np.testing.assert_allclose(compute_mean_sky_color(ViewStore.from_views(views)), [0.2, 0.4, 0.8], atol=1e-6)
    np.testing.assert_allclose(compute_mean_sky_color(ViewStore.from_views([view])), [0.6] * 3, atol=1e-6)


def test_instances_are_named_by_track_parked_box_and_lidar():
    clip = drive()
    start = build_initial_scene(clip, views_of(clip), CONFIG, 0, 0)
    means, nodes = start.gaussians.means, start.nodes
    parked = find_points_inside(means, clip.tracks[1].world_from_box[0], SIZE, 0.05, bottom=-0.02) & (nodes == 0)
    ids = np.where(nodes == 1, 3, np.where(parked, 2, 1)).astype(np.uint32)
    classes = find_instance_classes(clip, ids, means, nodes, ["Pickup Truck"])
    assert classes == {1: "Road", 2: "Car", 3: "Pickup Truck"}
    assert make_display_names(ids, {1: "Road"}) == {1: "Road 1", 2: "instance 2", 3: "instance 3"}
