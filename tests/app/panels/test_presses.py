"""A double click is one also where frames last so long that its time is over."""

import pytest

from instdrive_app.panels.viewport import Press, is_quick_repeat


@pytest.mark.parametrize(
    ("frames", "pixels", "repeats"), [(2, 0.0, True), (2, 5.0, True), (2, 30.0, False), (5, 0.0, False)]
)
def test_a_press_in_the_next_frames_and_at_the_same_place_repeats_the_one_before(frames, pixels, repeats):
    assert is_quick_repeat(Press(10, 200.0, 100.0), Press(10 + frames, 200.0 + pixels, 100.0)) is repeats
