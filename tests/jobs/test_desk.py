"""The desk of a running job: time left, curves, holding and stopping."""

import threading
import time

import pytest

from instdrive_core.jobs import desk as desk_module
from instdrive_core.jobs.desk import MOST_POINTS, JobDesk, JobStoppedError
from instdrive_core.jobs.job_file import CurvePoint, JobRequest, JobStage, JobState, ask_job, read_job_state


@pytest.fixture
def clock(monkeypatch):
    """Seconds that pass only as the test says."""
    now = [100.0]
    monkeypatch.setattr(desk_module.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def desk(tmp_path):
    made = JobDesk(tmp_path, JobState(JobRequest("/photos"), stages=(JobStage("masks", "Masks"), JobStage("x", "X"))))
    made.begin("masks")
    return made


def test_time_left_follows_from_the_speed_since_a_step_began(clock, desk):
    desk.advance("reading", 0.0)
    assert desk.state.seconds_left is None
    clock[0] += 10
    desk.advance("reading", 0.25)
    assert desk.state.seconds_left == pytest.approx(30)
    desk.advance("drawing", 0.5)  # another kind of work: its speed is not known
    assert desk.state.seconds_left is None


def test_a_resumed_step_does_not_count_what_was_done_before(clock, desk):
    desk.advance("training: step 500", 0.5)
    clock[0] += 20
    desk.advance("training: step 600", 0.6)
    assert desk.state.seconds_left == pytest.approx(80)


def test_seconds_are_those_of_the_stage(clock, desk):
    clock[0] += 3
    desk.advance("reading", 0.5)
    clock[0] += 4
    desk.end("masks")
    desk.begin("x")
    clock[0] += 5
    desk.end("x")
    assert [stage.seconds for stage in desk.state.stages] == [7, 5]
    assert [stage.status for stage in desk.state.stages] == ["done", "done"]


def test_points_done_again_replace_those_of_before(desk):
    for iteration in (10, 20, 30):
        desk.add_point(CurvePoint("rgb", iteration, 1.0, 20.0))
    desk.add_point(CurvePoint("rgb", 20, 0.5, 21.0))
    assert [(point.iteration, point.loss) for point in desk.state.curve] == [(10, 1.0), (20, 0.5)]


def test_long_curves_are_thinned_to_their_whole_length(desk):
    for iteration in range(MOST_POINTS + 20):
        desk.add_point(CurvePoint("rgb", iteration, 1.0, 20.0))
    assert len(desk.state.curve) <= MOST_POINTS
    assert desk.state.curve[0].iteration == 0
    assert desk.state.curve[-1].iteration == MOST_POINTS + 19


def test_a_job_asked_to_stop_stops_at_its_next_report(tmp_path, desk):
    desk.advance("reading", 0.1)
    ask_job(tmp_path, "stop")
    with pytest.raises(JobStoppedError):
        desk.advance("reading", 0.2)


@pytest.mark.parametrize("then", ["run", "stop"])
def test_a_job_holds_until_it_is_asked_otherwise(tmp_path, desk, then):
    ask_job(tmp_path, "pause")
    seen = []

    def ask():
        while read_job_state(tmp_path).status != "paused":
            time.sleep(0.01)
        seen.append("paused")
        ask_job(tmp_path, then)

    thread = threading.Thread(target=ask)
    thread.start()
    if then == "stop":
        with pytest.raises(JobStoppedError):
            desk.advance("reading", 0.2)
    else:
        desk.advance("reading", 0.2)
        assert read_job_state(tmp_path).status == "running"
    thread.join()
    assert seen == ["paused"]
