"""Progress told from inside long work."""

import threading

import pytest
from random_scene import random_scene

from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.progress import CancelledError, report, report_span, report_to


def test_without_a_listener_nothing_happens():
    told = []
    with report_to(told.append):
        report(0.5)
    report(0.6)
    assert told == [0.5]


def test_parts_are_scaled_and_nested():
    told = []
    with report_to(told.append):
        with report_span(0.0, 0.5), report_span(0.5, 1.0):
            report(0.5)
        report(2.0)
    assert told == [0.0, 0.25, 0.375, 1.0]
    report(0.1)
    assert len(told) == 4


def test_a_listener_stops_the_work_and_belongs_to_its_thread():
    def stop(share):
        raise CancelledError("stopped")

    with report_to(stop):
        other = threading.Thread(target=report, args=(0.5,))
        other.start()
        other.join()
        with pytest.raises(CancelledError):
            report(0.5)


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".spz", ".splat"])
def test_opening_and_saving_tell_how_far_they_are_and_stop_when_asked(tmp_path, suffix):
    scene = freeze_at_time(random_scene(count=900, features=0), 0.0)
    path, told = tmp_path / f"scene{suffix}", []
    with report_to(told.append):
        save_scene(path, scene)
    assert told
    assert all(0 <= share <= 1 for share in told)
    before = path.read_bytes()
    told.clear()
    with report_to(told.append):
        open_scene(path)
    assert told

    def stop(share):
        raise CancelledError("stopped")

    with report_to(stop), pytest.raises(CancelledError):
        open_scene(path)
    with report_to(stop), pytest.raises(CancelledError):
        save_scene(path, scene)
    assert path.read_bytes() == before, "what was there is still there"
    assert [file.name for file in tmp_path.iterdir()] == [path.name], "nothing is left over"
