"""Depths that posed photos agree on, against those of painted streets."""

from dataclasses import replace

import numpy as np
import pytest
from moving_photos import Board, make_clip, paint_with_depth, standing_board
from PIL import Image

from instdrive_core.progress import CancelledError, report_to
from instdrive_core.stereo.photo_depths import estimate_depths

BOARDS = (standing_board(3.0, 22), standing_board(-2.5, 30))


def estimate(clip, boards):
    """Depth maps of a clip's photos, and the true depths at their size."""
    frames = clip.frames

    def load_grey(number, camera):
        grey = Image.fromarray(frames[number].load_image()).convert("L")
        return np.asarray(grey.resize((camera.width, camera.height), Image.Resampling.BOX), np.float32)

    maps = estimate_depths([frame.view.camera for frame in frames], load_grey)
    true = [paint_with_depth(one.camera, frame.view.time, boards)[2] for one, frame in zip(maps, frames, strict=True)]
    return maps, true


@pytest.fixture(scope="module")
def street():
    return estimate(make_clip(BOARDS, 8), BOARDS)


def test_depths_are_right_where_photos_agree_on_one(street):
    errors = np.concatenate(
        [
            np.abs(found.depths[known] - true[known]) / true[known]
            for found, true in zip(*street, strict=True)
            for known in [(found.depths > 0) & np.isfinite(true)]
        ]
    )
    assert np.median(errors) < 0.03
    assert (errors > 0.15).mean() < 0.05


def test_much_of_what_several_photos_show_is_known(street):
    near = [(found.depths > 0)[true < 25].mean() for found, true in zip(*street, strict=True)]
    assert np.mean(near) > 0.4


def test_the_sky_has_no_depth(street):
    sky = [(found.depths > 0)[np.isinf(true)].mean() for found, true in zip(*street, strict=True)]
    assert np.mean(sky) < 0.02


def test_nobody_confirms_what_moves():
    crossing = (Board(lambda time: (4.0 - 8 * time, 16 + 8 * time), 3.0, 2.0),)
    (maps, _), clip = estimate(make_clip(crossing, 8), crossing), make_clip(crossing, 8)
    known, board, ground = [], [], []
    for found, frame in zip(maps, clip.frames, strict=True):
        labels = paint_with_depth(found.camera, frame.view.time, crossing)[1]
        known.append(found.depths > 0)
        board.append(labels == 3)
        ground.append(labels == 1)
    known, board, ground = (np.concatenate([part.ravel() for part in parts]) for parts in (known, board, ground))
    assert known[board].mean() < 0.5 * known[ground].mean()


def test_the_same_photos_give_the_same_depths(street):
    again, _ = estimate(make_clip(BOARDS, 8), BOARDS)
    for first, second in zip(street[0], again, strict=True):
        np.testing.assert_array_equal(first.depths, second.depths)


def test_photos_from_one_place_or_alone_tell_nothing():
    clip = make_clip(BOARDS, 3, speed=0.0)
    for part in (clip, replace(clip, frames=clip.frames[:1])):
        maps, _ = estimate(part, BOARDS)
        assert not any(found.depths.any() for found in maps)


def test_slivers_of_photos_are_not_compared():
    clip = make_clip(BOARDS, 6)
    slivers = [
        replace(frame, view=replace(frame.view, camera=frame.view.camera.resize(240, height)))
        for frame, height in zip(clip.frames, (140, 140, 140, 140, 140, 2), strict=True)
    ]
    maps, _ = estimate(replace(clip, frames=tuple(slivers)), BOARDS)
    assert maps[-1].depths.shape == (2, 240)
    assert not maps[-1].depths.any()
    assert maps[2].depths.any()


def test_progress_is_told_and_can_stop_the_work():
    clip, shares = make_clip(BOARDS, 4), []
    with report_to(shares.append):
        estimate(clip, BOARDS)
    assert shares == sorted(shares)
    assert shares[-1] == 1

    def stop(share):
        raise CancelledError

    with report_to(stop), pytest.raises(CancelledError):
        estimate(clip, BOARDS)
