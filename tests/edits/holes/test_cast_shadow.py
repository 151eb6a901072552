"""In what light a hole lies."""

from __future__ import annotations

import numpy as np
import pytest

from instdrive_core.edits.holes.cast_shadow import lies_in_shade

SIZE = 0.2


def _make_hole() -> np.ndarray:
    hole = np.zeros((100, 60), bool)
    hole[40:62, 20:30] = True
    return hole


@pytest.mark.parametrize(("start", "wanted"), [(0, True), (30, True), (58, False), (100, False)])
def test_shade_of_a_house_over_most_of_the_street_counts(start: int, wanted: bool) -> None:
    shaded = np.zeros((100, 60), bool)
    shaded[start:] = True
    assert lies_in_shade(shaded, np.ones_like(shaded), _make_hole(), SIZE) == wanted


def test_the_shadow_of_what_stood_there_is_no_shade() -> None:
    hole = _make_hole()
    shaded = np.roll(hole, 5, axis=1) & ~hole
    assert not lies_in_shade(shaded, ~hole, hole, SIZE)


def test_unknown_ground_says_nothing() -> None:
    hole = _make_hole()
    assert not lies_in_shade(np.ones_like(hole), np.zeros_like(hole), hole, SIZE)
