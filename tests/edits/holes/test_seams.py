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
