"""Copies meet each other and what is around them without a step."""

import numpy as np

from instdrive_core.edits.holes.seams import blend_copies


def picture_with_hole():
    """A ramp of brightness, and a hole that is filled from where it is darker."""
    ramp = np.repeat(np.linspace(0.2, 0.8, 40)[:, None], 20, axis=1)[..., None]
    hole = np.zeros((40, 20), bool)
    hole[24:32, 6:14] = True
    offsets = np.zeros((40, 20, 2), np.int64)
    offsets[hole] = (-16, 0)
    return ramp, hole, offsets


def test_the_light_of_copies_is_that_around_the_hole():
    ramp, hole, offsets = picture_with_hole()
    blended = blend_copies(ramp, ~hole, hole, offsets, hold=0.0)
    np.testing.assert_allclose(blended, ramp, atol=1e-9)
    held = blend_copies(ramp, ~hole, hole, offsets, hold=1e3)
    np.testing.assert_allclose(held[hole], ramp[np.roll(hole, -16, 0)], atol=0.01)


def test_what_is_not_known_does_not_count():
    ramp, hole, offsets = picture_with_hole()
    stained = ramp.copy()
    stained[32:34, 6:14] = 5.0
    known = ~hole & (stained[..., 0] < 1)
    blended = blend_copies(stained, known, hole, offsets, hold=0.0)
    np.testing.assert_allclose(blended[hole], ramp[hole], atol=1e-9)


def test_no_hole_changes_nothing():
    ramp, hole, offsets = picture_with_hole()
    np.testing.assert_array_equal(blend_copies(ramp, ~hole, np.zeros_like(hole), offsets), ramp)


def test_copies_meet_at_a_kerb_with_its_step():
    picture, levels = np.full((30, 20, 1), 0.3), np.zeros((30, 20))
    picture[:, 10:], levels[:, 10:] = 0.7, 0.15
    hole = np.zeros((30, 20), bool)
    hole[16:28, 4:16] = True
    offsets = np.zeros((30, 20, 2), np.int64)
    offsets[hole] = (-14, 0)
    offsets[16:28, 10:13] = (-14, -6)  # the carriageway reaches farther here
    known = ~hole
    known[28:] = known[:, 16:] = False
    road = blend_copies(picture, known, hole, offsets, levels=levels)[16:28, 11, 0]
    np.testing.assert_allclose(road, 0.3, atol=1e-6)
    assert blend_copies(picture, known, hole, offsets)[16:28, 11, 0].max() > 0.4, "the kerb would be smoothed away"
