"""Scores of found tracks: what is followed, found, false, and taken for another."""

import numpy as np
import pytest

from instdrive_core.evaluation.metrics.track_scores import Mover, score_tracks
from instdrive_core.scene.track import Track

TIMES = 0.1 * np.arange(10)
COUNTS = np.array([200, 100, 50, 50, 20, 20, 20, 20, 10, 10])
"""Points by sweep of something that drives away: 500."""


def drive(name, times=TIMES, left=0.0, speed=10.0):
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = left, speed * times
    return Track(name, "Car", np.array([1.9, 4.5, 1.6]), times, poses, moving=True)


def score(*found):
    truth = drive("truth")
    return score_tracks(found, [Mover(truth, TIMES, COUNTS)], (truth,))


def test_what_is_followed_counts_by_points():
    assert score(drive("a")).followed == 1.0
    assert score(drive("a", TIMES[:2])).followed == pytest.approx(0.6)
    late = score(drive("a", TIMES[2:]))
    assert late.followed == pytest.approx(0.4)
    assert late.found == 1, "half of its sweeps are enough to be found, which hides what is lost"
    assert score().followed == 0.0


def test_what_lies_beside_follows_nothing_and_is_false():
    beside = score(drive("a", left=5.0))
    assert beside.followed == 0.0
    assert beside.false_ids == ("a",)
    assert beside.missed == ("truth",)


def test_two_tracks_of_one_object_are_a_switch_and_follow_it_all_the_same():
    halves = score(drive("a", TIMES[:5]), drive("b", TIMES[5:]))
    assert halves.switches == 1
    assert halves.followed == 1.0
    assert halves.errors == pytest.approx(np.zeros(10), abs=1e-9)
