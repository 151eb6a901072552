"""Progress told from inside long work."""

import threading

import pytest

from instdrive_core.progress import CancelledError, part_of_work, report, reporting


def test_without_a_listener_nothing_happens():
    report(0.5)


def test_parts_are_scaled_and_nested():
    told = []
    with reporting(told.append):
        with part_of_work(0.0, 0.5), part_of_work(0.5, 1.0):
            report(0.5)
        report(2.0)
    assert told == [0.0, 0.25, 0.375, 1.0]
    report(0.1)
    assert len(told) == 4


def test_a_listener_stops_the_work_and_belongs_to_its_thread():
    def stop(share):
        raise CancelledError("stopped")

    with reporting(stop):
        other = threading.Thread(target=report, args=(0.5,))
        other.start()
        other.join()
        with pytest.raises(CancelledError):
            report(0.5)
