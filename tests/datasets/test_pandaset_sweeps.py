"""Points of time steps without a sweep come from the neighbours, those on moving objects carried along."""

from dataclasses import replace

import numpy as np
import pytest
from small_clip import moving_position, offset, sweep_at, write_small_clip

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.sweeps import SweepCache


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    root = write_small_clip(tmp_path_factory.mktemp("clip"))
    return load_clip(str(root), ClipOptions(cameras="front_camera"))


def world_points(clip, index, held_out=False):
    return SweepCache(clip, held_out).load(index).points + clip.origin


def test_a_step_with_a_sweep_has_just_its_own(clip):
    np.testing.assert_allclose(world_points(clip, 2), sweep_at(2)[0], atol=1e-4)
    np.testing.assert_allclose(world_points(clip, 4, held_out=True), sweep_at(4)[0], atol=1e-4)


def test_other_steps_have_their_neighbours_points_where_objects_are_by_then(clip):
    points = world_points(clip, 3, held_out=True)
    standing = [sweep_at(index)[0][:3] for index in (2, 4)]
    moved = [moving_position(3), moving_position(3) + offset(0.4, 0.5, 0.0)]
    expected = np.concatenate([standing[0], moved, standing[1], moved])
    np.testing.assert_allclose(points, expected, atol=1e-3)


def test_the_second_lidars_points_on_moving_objects_are_left_out(clip):
    found = SweepCache(clip, held_out=True).load(3)
    assert not found.sensor.any()
    assert len(found.points) == len(found.classes) == len(found.intensity)


@pytest.mark.parametrize(("index", "sources"), [(3, {2, 6}), (4, {2, 6}), (5, {2, 6}), (6, {6})])
def test_training_never_sees_a_held_out_sweep(clip, monkeypatch, index, sources):
    cache = SweepCache(clip, held_out=False)
    loaded = set()
    monkeypatch.setattr(
        cache,
        "_load_sweep",
        lambda position: (loaded.add(cache.sweeps[position].index), cache.sweeps[position].load())[1],
    )
    assert len(cache.load_positions(index))
    assert loaded == sources
    assert 4 not in {sweep.index for sweep in cache.sweeps}


def test_all_cameras_of_a_step_share_its_points(clip):
    cache = SweepCache(clip, held_out=True)
    first = cache.load(3)
    assert cache.load(3) is first
    assert cache.load(5) is not first
    np.testing.assert_array_equal(cache.load(3).points, first.points)


def test_a_clip_without_sweeps_has_no_points(clip):
    bare = replace(clip, sweeps=())
    assert SweepCache(bare).load(3) is None
    assert SweepCache(bare).load_positions(3).shape == (0, 3)


def test_objects_that_are_gone_by_then_are_left_out(clip):
    tracks = tuple(replace(t, times=t.times[:1], world_from_box=t.world_from_box[:1]) for t in clip.tracks)
    points = world_points(replace(clip, tracks=tracks), 3)
    np.testing.assert_allclose(points[:3], sweep_at(2)[0][:3], atol=1e-4)
    assert np.linalg.norm(points[3:] - moving_position(2), axis=1).min() > 2


def test_points_keep_their_times(clip):
    sweep = clip.sweeps[0]
    np.testing.assert_allclose(sweep.load().times, sweep.time, atol=1e-6)
