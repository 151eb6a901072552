"""Photos tell depths where a clip has no LiDAR, and say how much they agree on."""

from dataclasses import replace

import numpy as np
import pytest
from moving_photos import make_clip, paint_with_depth, standing_board
from small_clip import write_small_clip

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.training.views.photo_depth import (
    choose_compared_frames,
    estimate_missing_depths,
    expect_comparing_seconds,
)
from instdrive_core.training.views.view_store import open_view_store

BOARDS = (standing_board(3.0, 22),)


@pytest.fixture(scope="module")
def street():
    notes = []
    clip = make_clip(BOARDS, 8)
    depths = estimate_missing_depths(clip, notes.append)
    assert depths is not None
    return clip, depths, notes


def test_depths_belong_to_the_photos_own_pixels(street):
    clip, depths, notes = street
    assert len(depths) == len(clip.training_frames)
    errors = []
    for (pixels, values), frame in zip(depths, clip.training_frames, strict=True):
        true = paint_with_depth(frame.view.camera, frame.view.time, BOARDS)[2].ravel()[pixels]
        assert (np.diff(pixels) > 0).all()
        errors.append(np.abs(values / true - 1))
    assert np.median(np.concatenate(errors)) < 0.03
    assert any("photos agree on how far off" in note for note in notes)


def test_pixels_that_are_not_valid_have_none(street):
    clip = street[0]
    lower = np.ones((140, 240), bool)
    lower[100:] = False
    masked = replace(clip, frames=tuple(replace(frame, valid=lower) for frame in clip.frames))
    depths = estimate_missing_depths(masked, lambda note: None)
    assert depths is not None
    assert max(pixels.max() for pixels, _ in depths) < 100 * 240


def test_views_say_that_nobody_measured_them(street):
    clip, depths, _ = street
    with open_view_store(clip, None, photo_depths=depths) as store:
        view = store.get(0)
        np.testing.assert_array_equal(view.depth_values, depths[0][1])
        assert not view.measured
        assert not view.halve().measured
    with open_view_store(clip, None) as store:
        assert store.get(0).measured
        assert not len(store.get(0).depth_pixels)


def test_the_time_it_takes_follows_the_photos(street):
    clip = street[0]
    half = replace(clip, frames=clip.frames[:4])
    assert 0 < expect_comparing_seconds(half) < expect_comparing_seconds(clip) < 20


def test_lidar_needs_no_photos(tmp_path):
    clip = load_clip(str(write_small_clip(tmp_path / "clip")), ClipOptions())
    assert expect_comparing_seconds(clip) == 0
    assert estimate_missing_depths(clip, pytest.fail) is None


def test_of_very_many_photos_all_cameras_of_some_steps_are_compared(street):
    frame = street[0].frames[0]
    many = [
        replace(frame, view=replace(frame.view, name=name, index=step)) for step in range(300) for name in ("a", "b")
    ]
    chosen = choose_compared_frames(many)
    assert len(chosen) == 300
    assert [many[number].view.index for number in chosen[:4]] == [0, 0, 2, 2]
    assert choose_compared_frames(many[:400]) == list(range(400))


def test_photos_with_the_poses_of_others_are_told(street):
    clip, notes = street[0], []
    others = tuple(replace(frame, load_image=clip.frames[-1 - row].load_image) for row, frame in enumerate(clip.frames))
    depths = estimate_missing_depths(replace(clip, frames=others), notes.append)
    assert depths is not None
    assert not any(len(pixels) for pixels, _ in depths)
    assert "photos agree on no depths" in notes[-1]
