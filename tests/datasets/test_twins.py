"""Tracks that lie in each other all the way are one object; others stay apart."""

import numpy as np
import pytest

from instdrive_core.datasets.twins import are_twins, merge_twins
from instdrive_core.scene.track import Track

CAR = (1.9, 4.6, 1.6)
STEPS = np.arange(10) / 10


def track(name, x, y=0.0, times=STEPS, size=CAR):
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = x, y
    return Track(name, "Car", np.array(size), np.asarray(times, float), poses, moving=True)


ALONG = 8.0 * np.arange(10) / 10


def test_twins_half_a_metre_apart_are_one_object():
    merged = merge_twins((track("a", ALONG), track("b", ALONG + 0.5), track("c", ALONG + 8)))
    assert [one.id for one in merged.tracks] == ["a", "c"]
    assert merged.merged == {"a": ("b",)}
    assert merged.note() == (
        "a track lies in the box of another all the way and went up in it, as one object: a with b"
    )


def test_the_pose_nearest_to_the_exposure_is_kept_and_gaps_are_filled():
    times = np.arange(10) / 10
    spinning, second = track("s", ALONG[:6], times=times[:6]), track("a", ALONG + 0.5)
    merged = merge_twins((second, spinning), lambda one: one.id == "a")
    (whole,) = merged.tracks
    assert whole.id == "s"
    np.testing.assert_allclose(whole.times, times)
    np.testing.assert_allclose(whole.world_from_box[:, 0, 3], [*ALONG[:6], *(ALONG[6:] + 0.5)])


def test_twins_need_not_share_every_step():
    late = ALONG + 0.5
    late[:3] += 5
    assert are_twins(track("a", ALONG), track("b", late))
    late[:6] = ALONG[:6] + 5
    assert not are_twins(track("a", ALONG), track("b", late))


@pytest.mark.parametrize(
    "other",
    [
        track("far", ALONG + 2.0),
        track("person", ALONG, size=(0.6, 0.6, 1.7)),
        track("later", ALONG, times=5 + np.arange(10) / 10),
        track("crossing", ALONG[::-1].copy()),
    ],
    ids=lambda one: one.id,
)
def test_others_stay_apart(other):
    own = track("a", ALONG)
    assert merge_twins((own, other)).tracks == (own, other)
    assert merge_twins((own, other)).note() is None


def test_people_side_by_side_are_two():
    person = (0.7, 0.7, 1.7)
    assert not are_twins(track("a", ALONG, size=person), track("b", ALONG, 0.6, size=person))


def test_each_of_three_twins_is_told():
    merged = merge_twins((track("a", ALONG), track("b", ALONG + 0.5), track("c", ALONG - 0.5)))
    assert len(merged.tracks) == 1
    assert "2 tracks lie" in merged.note()
