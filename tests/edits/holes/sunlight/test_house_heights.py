"""Heights of houses follow from the ground in their shade."""

import numpy as np
import pytest

from instdrive_core.edits.holes.sunlight.house_heights import add_ground, infer_heights, weigh_seen_tops
from instdrive_core.edits.holes.sunlight.standing_rows import HEIGHTS


def test_two_heights_and_the_jump_between_them_are_found():
    rng = np.random.default_rng(0)
    truth = np.where(np.arange(60) < 25, 5.0, 9.0)
    places = rng.integers(0, 60, 900)
    places = places[(places < 40) | (places > 48)]  # nothing is known of these
    needed = rng.uniform(2, 13, len(places))
    told = np.where(truth[places] > needed, 1.0, -1.0)
    chances, _ = infer_heights(add_ground(places, needed, told, 60))
    means = chances @ HEIGHTS
    assert means == pytest.approx(truth, abs=0.6)
    assert chances.sum(axis=1) == pytest.approx(np.ones(60))


def test_houses_are_as_high_as_seen_and_hardly_higher_where_photos_would_show_it():
    tops = np.full(20, 6.0)
    framed = np.zeros((20, len(HEIGHTS)))
    unknown, _ = infer_heights(weigh_seen_tops(tops, framed))
    known, _ = infer_heights(weigh_seen_tops(tops, framed + 10))
    assert unknown[:, HEIGHTS < 5.5].sum(axis=1).max() < 0.01
    assert unknown[10] @ HEIGHTS > 10
    assert known[10] @ HEIGHTS == pytest.approx(6.0, abs=0.7)
