"""Saving, reopening, recovering and leaving, through the real window."""

import time

import pytest
from procedural_street import FIRST_CAR
from window_driver import PATIENCE, editor_display, start_editor

from instdrive_core.project.open import open_document
from instdrive_core.project.session_folder import JOURNAL

pytestmark = pytest.mark.gui

RED_CAR, BLUE_CAR = FIRST_CAR, FIRST_CAR + 1


@pytest.fixture
def open_window(tmp_path):
    """A function that opens the editor on a path; all editors share one state folder."""
    drivers = []

    def start(path):
        drivers.append(start_editor(path, tmp_path, f"editor{len(drivers)}"))
        return drivers[-1]

    with editor_display():
        try:
            yield start
        finally:
            for driver in drivers:
                driver.close()


def delete(window, instance):
    window.click_widget(f"instances.{instance}")
    window.wait_for_selection(instance)
    window.key("Delete")
    window.wait_for(lambda state: instance not in state["visible"], "the instance to be deleted")


def test_save_reopen_and_go_on_undoing(open_window, street_folder, tmp_path):
    window = open_window(street_folder)
    delete(window, RED_CAR)
    project = tmp_path / "drive.instdrive"
    window.key("ctrl+s")
    window.enter_path(project)
    window.wait_for(lambda state: not state["unsaved"] and project.exists(), "the project to be saved")
    delete(window, BLUE_CAR)
    window.key("ctrl+z")
    window.wait_for(lambda state: not state["unsaved"], "the saved state again")
    assert window.quit() == 0, "nothing is unsaved: no question"

    again = open_window(project)
    assert RED_CAR not in again.state["visible"]
    again.key("ctrl+z")
    again.wait_for(lambda state: RED_CAR in state["visible"], "an edit of the last session to be undone")
    again.key("ctrl+q")
    again.click_widget("question.Save")
    assert again.wait_for_end() == 0
    document, _ = open_document(project)
    assert RED_CAR in document.find_visible_instances()
    assert document.history.edits, "what was undone can be redone"


def test_giving_up_a_save_on_the_way_out_stays(open_window, street_folder, tmp_path):
    window = open_window(street_folder)
    delete(window, RED_CAR)
    window.key("ctrl+q")
    window.click_widget("question.Save")
    window.click_widget("dialog.cancel")
    project = tmp_path / "drive.instdrive"
    window.key("ctrl+s")
    window.enter_path(project)
    window.wait_for(lambda state: not state["unsaved"] and project.exists(), "the project to be saved")
    assert not window.wait_until_calm(1.0)["unsaved"], "the save that came later ended nothing"
    assert window.quit() == 0


def wait_until_written(recovery, deletions):
    """The editor writes what was done within a second, on a thread of its own."""
    end = time.monotonic() + PATIENCE
    while sum(journal.read_text().count("delete_instances") for journal in recovery.glob(f"*/{JOURNAL}")) < deletions:
        assert time.monotonic() < end, "the edits are not written"
        time.sleep(0.05)


@pytest.mark.slow
def test_work_of_a_killed_editor_is_offered(open_window, street_folder, tmp_path):
    window = open_window(street_folder)
    delete(window, RED_CAR)
    delete(window, BLUE_CAR)
    wait_until_written(tmp_path / "state" / "recovery", deletions=2)
    window.kill()

    again = open_window(street_folder)
    again.click_widget("recovery.0.recover")
    state = again.wait_for(lambda state: RED_CAR not in state["visible"], "the work to be recovered")
    assert BLUE_CAR not in state["visible"]
    assert state["unsaved"]
    again.key("ctrl+z")
    again.wait_for(lambda state: BLUE_CAR in state["visible"], "a recovered edit to be undone")
    again.key("ctrl+q")
    again.click_widget("question.Cancel")
    assert again.wait_until_calm()["unsaved"], "still there"
    assert again.quit() == 0

    last = open_window(street_folder)
    assert "recovery.later" not in last.state["widgets"], "what was left by choice is not offered"
