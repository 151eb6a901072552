"""The driver with workers that end as the tests say: retries, resume, stops, the page, and who may drive."""

import json
import time
from dataclasses import replace

import pytest

from instdrive_core.errors import OptionError
from instdrive_core.fleet.clip_work import ClipOutcome
from instdrive_core.fleet.driver import FleetDriver, FleetOrder
from instdrive_core.fleet.hold import hold_place
from instdrive_core.fleet.place import open_place
from instdrive_core.fleet.plan import ClipWishes, plan_fleet
from instdrive_core.jobs.job_file import JobRequest, JobStage, JobState, write_job_state

DONE, LOST = ClipOutcome("done"), ClipOutcome("failed", "the worker was lost <SIGKILL>", may_repeat=True)
BAD = ClipOutcome("failed", "no data set")


class ScriptedPool:
    """Ends the tasks of each clip as its script says; `stops` come once the driver asks for them."""

    def __init__(self, scripts):
        self.scripts, self.tasks, self.submitted, self.is_stopping = scripts, [], [], False

    def submit(self, task):
        self.tasks.append(task)
        self.submitted.append(task.clip.name)

    def collect(self, seconds):
        if self.is_stopping:
            ended, self.tasks = self.tasks, []
            return [(task, ClipOutcome("stopped")) for task in ended]
        task = self.tasks.pop(0)
        outcome = self.scripts[task.clip.name].pop(0)
        if isinstance(outcome, BaseException):
            self.tasks.append(task)
            raise outcome
        return [(task, outcome)]

    def stop(self):
        self.is_stopping = True


@pytest.fixture
def order(tmp_path):
    return FleetOrder(plan_fleet(["s3://x/a", "s3://x/b"]), open_place(str(tmp_path)), ClipWishes(), "", retries=2)


def finish_job(folder):
    stages = (JobStage("train", "Training", "done", 1.0, 90.0),)
    write_job_state(folder, JobState(JobRequest("s3://x/a"), "done", stages, notes=("<b>12 masks</b>",)))
    (folder / "eval.json").write_text(json.dumps({"psnr": 28.256, "click": {"hit_rate": 0.926}}))
    (folder / "run.json").write_text(json.dumps({"n_instances": 177, "n_gaussians": 180_000}))


def test_a_lost_worker_is_tried_again_and_a_bad_clip_is_not(order):
    pool = ScriptedPool({"a": [LOST, LOST, DONE], "b": [BAD]})
    first, second = FleetDriver(order, pool).run()
    assert sorted(pool.submitted) == ["a", "a", "a", "b"]
    assert (first.status, len(first.attempts), first.problem) == ("done", 2, "")
    assert (second.status, second.problem) == ("failed", "no data set")


def test_retries_end(order):
    pool = ScriptedPool({"a": [LOST] * 9, "b": [DONE]})
    record = FleetDriver(order, pool).run()[0]
    assert (record.status, len(record.attempts), record.problem) == ("failed", 3, LOST.problem)


def test_what_is_finished_is_not_done_again_unless_a_recording_is_wanted(order, tmp_path):
    finish_job(tmp_path / "a")
    pool = ScriptedPool({"b": [DONE]})
    assert [record.status for record in FleetDriver(order, pool).run()] == ["done", "done"]
    assert pool.submitted == ["b"]
    pool = ScriptedPool({"a": [DONE], "b": [DONE]})
    FleetDriver(replace(order, wishes=ClipWishes(record=True)), pool).run()
    assert pool.submitted == ["a", "b"]


def test_clips_of_earlier_calls_stay_on_the_page(order, tmp_path):
    FleetDriver(order, ScriptedPool({"a": [DONE], "b": [BAD]})).run()
    (record,) = FleetDriver(replace(order, clips=order.clips[:1]), ScriptedPool({"a": [DONE]})).run()
    assert record.clip.name == "a"
    known = {clip["name"]: clip for clip in json.loads((tmp_path / "fleet.json").read_text())["clips"]}
    assert (known["b"]["status"], known["b"]["problem"]) == ("failed", "no data set")
    assert "s3://x/b" in (tmp_path / "index.html").read_text()


def test_a_driver_that_is_stopped_lets_its_workers_stop(order, tmp_path):
    pool = ScriptedPool({"a": [KeyboardInterrupt()], "b": []})
    driver = FleetDriver(order, pool)
    with pytest.raises(KeyboardInterrupt):
        driver.run()
    written = json.loads((tmp_path / "fleet.json").read_text())
    assert written["status"] == "stopped"
    assert {clip["status"] for clip in written["clips"]} == {"stopped"}


def test_the_page_shows_all_figures_and_needs_nothing_else(order, tmp_path):
    finish_job(tmp_path / "a")
    FleetDriver(order, ScriptedPool({"b": [LOST, BAD]})).run()
    page = (tmp_path / "index.html").read_text()
    for words in ("28.26", "177", "93 %", "180,000", "1.5", 'href="a/report.html"', "no data set", "1 done, 1 failed"):
        assert words in page
    assert "&lt;SIGKILL&gt;" in page
    assert "<b>12 masks" not in page
    assert 'http-equiv="refresh"' not in page
    assert "://" not in page.replace("s3://x/", "")
    assert json.loads((tmp_path / "fleet.json").read_text())["clips"][0]["psnr"] == 28.256


def test_the_page_loads_itself_again_while_the_fleet_runs(order, tmp_path):
    pages = []

    def look():
        pages.append((tmp_path / "index.html").read_text())

    FleetDriver(order, ScriptedPool({"a": [DONE], "b": [DONE]}), on_look=look).run()
    assert 'http-equiv="refresh"' in pages[0]


@pytest.mark.parametrize("kind", ["folder", "address"])
def test_two_drivers_refuse_each_other(kind, tmp_path):
    if kind == "address":
        pytest.importorskip("fsspec")
    place = open_place(str(tmp_path) if kind == "folder" else f"memory://{tmp_path.name}")
    with hold_place(place), pytest.raises(OptionError, match="another `instdrive fleet` works here"), hold_place(place):
        pass
    with hold_place(place) as hold:  # free again
        hold.renew()


def test_a_driver_whose_address_was_taken_over_stops_and_leaves_it(tmp_path, monkeypatch):
    pytest.importorskip("fsspec")
    monkeypatch.setattr("instdrive_core.fleet.hold.RENEW_SECONDS", 0.0)
    place = open_place(f"memory://{tmp_path.name}")
    other = json.dumps({"holder": "another", "at": time.time()}).encode()
    with hold_place(place) as hold:
        place.write("fleet.lock", other)
        with pytest.raises(OptionError, match="has taken over"):
            hold.renew()
    assert place.read("fleet.lock") == other
