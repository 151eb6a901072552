"""Masks that move are found in photos, each thing once, kept out of training, and told; what stands is not."""

from dataclasses import replace

import numpy as np
import pytest
from moving_photos import Board, make_clip, standing_board, write_street_masks

from instdrive_core.datasets.clip import Sweep
from instdrive_core.tracks.photos.seen_movers import find_seen_movers, keep_out_movers, summarize_movers
from instdrive_core.tracks.photos.setting_apart import set_movers_apart

pytest.importorskip("cv2", reason="OpenCV is not installed")

PARKED = standing_board(-0.3, 35)
CROSSING = Board(lambda time: (-4 + 2 * time, 18.0))
AHEAD = Board(lambda time: (1.8, 8 + 8 * time))
BOARDS = (PARKED, CROSSING, AHEAD)


@pytest.fixture(scope="module")
def traffic(tmp_path_factory):
    clip = make_clip(BOARDS)
    masks = write_street_masks(tmp_path_factory.mktemp("traffic") / "masks", clip, BOARDS)
    return clip, masks, find_seen_movers(clip, masks)


def test_each_mover_is_found_once_where_it_is(traffic):
    clip, _, found = traffic
    assert len(found.movers) == 2
    steps = [frame.view.index for frame in clip.training_frames]
    for board in (CROSSING, AHEAD):
        frame = clip.frames[0]
        middle = np.array([[*board.at(0.0), board.height / 2]])
        column = frame.view.camera.project(middle)[0][0, 0] / frame.view.camera.width
        of_board = [mover for mover in found.movers if abs(np.mean(mover.sightings[0].box[::2]) - column) < 0.03]
        assert len(of_board) == 1
        assert [sighting.step for sighting in of_board[0].sightings] == steps
        assert of_board[0].camera == "front"


def test_their_pixels_are_kept_out_and_no_others(traffic):
    clip, masks, found = traffic
    kept = keep_out_movers(clip, found)
    for before, after in zip(clip.frames, kept.frames, strict=True):
        if before.view.held_out:
            assert after.valid is None, "held-out photos are left alone"
            continue
        labels = masks.load(before).labels
        assert not after.valid[labels >= 4].any()
        assert after.valid[labels == 3].mean() > 0.8, "the parked board stays"
        assert after.valid[labels < 3].mean() > 0.9


def test_a_street_where_all_stands_shows_nothing_moving(tmp_path):
    boards = (PARKED, standing_board(3, 14), standing_board(2, 30))
    clip = make_clip(boards)
    found = find_seen_movers(clip, write_street_masks(tmp_path, clip, boards))
    assert found.movers == ()
    assert found.pixels == {}
    assert keep_out_movers(clip, found).frames == clip.frames


def test_a_jam_of_creeping_cars_is_one_thing_for_each_car(tmp_path):
    """Stop and go: the recording car creeps at 2 m/s, the next lanes at 1 to 4 m/s, the last car stands at first."""
    boards = (
        Board(lambda time: (0.3, 7 + 2.6 * time)),
        Board(lambda time: (-2.6, 9 + 3.5 * time)),
        Board(lambda time: (3.2, 10 + max(0.0, 4 * (time - 0.5)))),
    )
    clip = make_clip(boards, count=22, speed=2.0)
    found = find_seen_movers(clip, write_street_masks(tmp_path, clip, boards))
    assert len(found.movers) == len(boards)
    for mover in found.movers:
        assert len(mover.sightings) >= 18, "also where it stands"


def test_the_user_is_told(traffic):
    clip, masks, found = traffic
    notes = []
    apart, movers = set_movers_apart(clip, masks, None, notes.append)
    assert movers == found.movers
    assert notes == [
        "2 things seen moving, not rebuilt: left out of 13 photos of front. "
        "Moving things are rebuilt where a clip has LiDAR"
    ]
    assert summarize_movers(movers) in notes[0]
    assert not all(frame.valid is None for frame in apart.frames)


def test_clips_with_lidar_and_users_who_want_no_tracks_keep_all(traffic):
    clip, masks, _ = traffic
    scanned = replace(clip, sweeps=(Sweep(0, 0.0, lambda: pytest.fail("is not read")),))
    for given, source in ((scanned, None), (clip, "none")):
        assert set_movers_apart(given, masks, source, pytest.fail) == (given, ())


def test_without_masks_a_note_says_what_to_do(traffic):
    notes = []
    assert set_movers_apart(traffic[0], None, None, notes.append) == (traffic[0], ())
    assert "instdrive masks" in notes[0]
