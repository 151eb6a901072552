"""From minutes to training steps."""

import pytest

from instdrive_core.jobs.pacing import (
    GROWTH,
    LEAST_STEPS,
    MOST_STEPS,
    TRAINED_SHARE,
    Pace,
    choose_pace,
    describe_pace,
)


def test_the_steps_fill_the_share_of_the_minutes_that_trains():
    pace = choose_pace(0.1, minutes=20, spent=0)
    assert pace.seconds == pytest.approx(20 * 60 * TRAINED_SHARE, rel=0.01)
    assert pace.step_seconds == pytest.approx(0.1 * GROWTH)


def test_more_minutes_and_faster_machines_mean_more_steps():
    few = choose_pace(0.1, 10, 0).iterations
    assert choose_pace(0.1, 20, 0).iterations == pytest.approx(2 * few, abs=2)
    assert choose_pace(0.05, 10, 0).iterations == pytest.approx(2 * few, abs=2)


def test_what_earlier_stages_took_is_taken_off_but_training_keeps_some():
    assert choose_pace(0.1, 20, 600).iterations < choose_pace(0.1, 20, 0).iterations
    assert choose_pace(0.1, 20, 60_000).seconds > 0.25 * 20 * 60


@pytest.mark.parametrize(("step_seconds", "minutes", "steps"), [(60.0, 1, LEAST_STEPS), (1e-4, 600, MOST_STEPS)])
def test_steps_stay_within_what_makes_sense(step_seconds, minutes, steps):
    assert choose_pace(step_seconds, minutes, 0).iterations == steps


@pytest.mark.parametrize(
    ("iterations", "words"), [(200, "a first look"), (30_000, "more than a usual training: fine detail")]
)
def test_the_user_is_told_what_to_expect(iterations, words):
    assert words in describe_pace(Pace(iterations, 0.1), photos=300)
