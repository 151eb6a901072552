"""How the fleet's benchmark counts steps that were trained again."""

import json

from benchmarks.fleet import TrainingWatch


def write_log(path, *steps):
    path.write_text(
        "".join(json.dumps({"stage": "rgb", "iteration": step, "seconds": at}) + "\n" for step, at in steps)
    )


def test_steps_that_are_logged_anew_count_as_repeated(tmp_path):
    watch = TrainingWatch(tmp_path / "log.jsonl")
    watch.look()
    write_log(watch.log, (10, 1.0), (20, 2.0), (30, 3.0))
    watch.look()
    watch.look()
    assert (watch.last, watch.count_repeated(10)) == (30, 0)
    write_log(watch.log, (10, 1.0), (20, 2.0))  # resumed at the checkpoint of step 20
    watch.look()
    write_log(watch.log, (10, 1.0), (20, 2.0), (30, 3.5), (40, 4.5))
    watch.look()
    assert (watch.last, watch.count_repeated(10)) == (40, 10)


def test_half_a_line_is_read_once_it_is_whole(tmp_path):
    watch = TrainingWatch(tmp_path / "log.jsonl")
    watch.log.write_text('{"stage": "rgb", "itera')
    watch.look()
    assert watch.last == 0
    write_log(watch.log, (10, 1.0))
    watch.look()
    assert watch.last == 10
