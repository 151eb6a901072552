"""What the window offers while no scene is open, what it is called, and messages that go at a click."""

import time

import pytest
from procedural_street import procedural_street
from window_driver import editor_window

from instdrive_app.cli.edit import ScaleError, edit
from instdrive_app.files.sample import find_sample_scene
from instdrive_app.memory import MemoryGauge, read_resident_bytes
from instdrive_app.messages import Messages
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.shell.window import format_title
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances


@pytest.fixture
def window(tmp_path):
    """The editor, after it was asked to open what is no scene."""
    broken = tmp_path / "broken.ply"
    broken.write_bytes(b"no scene at all")
    with editor_window(broken, tmp_path, opens=False) as driver:
        yield driver


@pytest.mark.gui
def test_a_window_without_a_scene_offers_to_open_one(window):
    window.wait_for_message("broken.ply")
    window.click_widget("toast.0")
    window.wait_for(lambda state: "toast.0" not in state["widgets"], "the error to go at a click")
    window.click_widget("empty.open")
    window.wait_for_widget("dialog.path")
    window.key("Escape")
    window.wait_for(lambda state: "dialog.path" not in state["widgets"], "the dialog to close")
    window.click_widget("empty.sample")
    state = window.wait_for(lambda state: state["open"], "the sample scene")
    assert "empty.sample" not in state["widgets"]
    assert any(find_sample_scene().name in text for text in state["messages"])
    assert window.quit() == 0


@pytest.mark.gui
def test_escape_closes_a_menu_and_nothing_else(window):
    window.click_widget("empty.sample")
    window.wait_for(lambda state: state["open"], "the sample scene")
    window.key("ctrl+a")
    window.wait_for(lambda state: state["selected"], "everything selected")
    window.click_widget("menu Help")
    window.wait_for_widget("menu help.log")
    window.key("Escape")
    window.wait_for(lambda state: "menu help.log" not in state["widgets"], "the menu to close")
    assert window.wait_until_calm()["selected"]
    window.key("Escape")
    window.wait_for(lambda state: not state["selected"], "nothing selected")


def test_the_title_names_the_document_and_what_is_unsaved(tmp_path):
    session = EditorSession()
    assert format_title(session) == "InstDrive"
    session.show(Document(procedural_street()), tmp_path / "street.ply")
    assert format_title(session) == "street.ply – InstDrive"
    session.history.apply(DeleteInstances(session.document.find_visible_instances()[:1]))
    assert format_title(session) == "street.ply • InstDrive"
    session.history.undo()
    assert format_title(session) == "street.ply – InstDrive"
    session.close()


def test_one_message_is_taken_away_and_the_log_keeps_it():
    messages = Messages(clock=lambda: 0.0)
    messages.info("first")
    messages.error("second")
    messages.dismiss(messages.toasts[0])
    assert [message.text for message in messages.toasts] == ["second"]
    assert [message.text for message in messages.log] == ["first", "second"]
    messages.dismiss()
    assert messages.toasts == ()


def test_memory_is_looked_up_once_a_second(monkeypatch):
    if read_resident_bytes() is None:
        pytest.skip("this system does not say how much memory a process holds")
    asked = []
    monkeypatch.setattr("instdrive_app.memory.read_resident_bytes", lambda: asked.append(1) or 5)
    now = time.monotonic()
    monkeypatch.setattr("instdrive_app.memory.time.monotonic", lambda: now)
    gauge = MemoryGauge()
    assert [gauge.resident, gauge.resident, len(asked)] == [5, 5, 1]
    now += 1.5
    assert [gauge.resident, len(asked)] == [5, 2]


@pytest.mark.parametrize("scale", [-1.0, 0.1, 50.0])
def test_scales_beyond_reason_are_refused(scale):
    with pytest.raises(ScaleError, match=f"--scale {scale:g}"):
        edit(scale=scale)
