"""The part of a log that is asked for in steps or seconds."""

import pytest

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.frame_range import build_range_test, describe_steps
from instdrive_core.errors import OptionError

TIMES = {step: 100.0 + 0.1 * step for step in range(20)}
"""A log whose clock does not begin at 0."""


@pytest.mark.parametrize(
    ("first", "last", "expected"),
    [
        (None, None, range(20)),
        (3, 5, range(3, 6)),
        ("0.3s", "0.5s", range(3, 6)),
        ("0.25 s", 5, range(3, 6)),
        (17, "60s", range(17, 20)),
        ("1s", None, range(10, 20)),
    ],
)
def test_steps_and_seconds_choose_the_same_part(first, last, expected):
    is_asked = build_range_test(ClipOptions(first_frame=first, last_frame=last), TIMES)
    assert [step for step in TIMES if is_asked(step)] == list(expected)


@pytest.mark.parametrize("wrong", ["3.5", "soon", "-1s", "1e3s", "s", ""])
def test_what_is_no_moment_is_refused(wrong):
    with pytest.raises(OptionError, match=r"--last .* is no moment; give a time step, e.g. 30, or seconds"):
        build_range_test(ClipOptions(last_frame=wrong), TIMES)


@pytest.mark.parametrize(("first", "last"), [(9, 8), ("2s", "1.9s")])
def test_ends_in_the_wrong_order_are_refused(first, last):
    with pytest.raises(OptionError, match=r"--first .* lies after --last"):
        build_range_test(ClipOptions(first_frame=first, last_frame=last), TIMES)


def test_what_there_is_can_be_said():
    assert describe_steps(TIMES) == "0–19, or 0–1.9s"
