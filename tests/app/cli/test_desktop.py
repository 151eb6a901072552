"""Starting the editor without a terminal, as a double click does."""

import logging
import subprocess
import sys

import pytest
from log_handlers import stop_logging

from instdrive_app import main
from instdrive_app.cli import desktop, edit
from instdrive_app.files import sample
from instdrive_app.log_file import get_log_path
from instdrive_app.session.editor_session import EditorSession


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """The texts of the message boxes; the log goes to a folder of the test."""
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path / "state"))
    texts, handlers = [], list(logging.getLogger().handlers)
    monkeypatch.setattr(desktop, "show_error", texts.append)
    yield texts
    for handler in logging.getLogger().handlers[:]:
        if handler not in handlers:
            stop_logging(handler)


def test_the_first_path_is_opened_and_the_others_are_named(shown, monkeypatch, tmp_path):
    opened = []
    monkeypatch.setattr(desktop, "run_editor", lambda path, left_out: opened.append((path, left_out)))
    (tmp_path / "a.ply").write_bytes(b"")
    assert main.gui([str(tmp_path / "a.ply"), "b.ply"]) == 0
    assert main.gui([]) == 0
    (path, others), (sample_path, none) = opened
    assert (path.name, [other.name for other in others]) == ("a.ply", ["b.ply"])
    assert (sample_path, none) == (sample.find_sample_scene(), [])
    assert shown == []


def test_an_error_is_shown_and_logged(shown, monkeypatch):
    assert main.gui(["missing.ply"]) == 2
    assert "missing.ply: there is no such file" in shown[0]
    monkeypatch.setattr(desktop, "run_editor", lambda *_, **__: 1 / 0)
    assert main.gui([]) == 1
    assert "ZeroDivisionError" in shown[1]
    assert str(get_log_path()) in shown[1]
    log = get_log_path().read_text(encoding="utf-8")
    assert "missing.ply: there is no such file" in log
    assert "Traceback" in log


def test_paths_that_are_left_out_are_told(shown, monkeypatch, street_folder):
    sessions = []

    class Window:
        def __init__(self, session, _):
            sessions.append(session)

        def run(self):
            pass

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("instdrive_app.shell.window.EditorWindow", Window)
    edit.run_editor(street_folder, left_out=[street_folder.parent / "other.ply"])
    (session,) = sessions
    assert isinstance(session, EditorSession)
    assert "Left out: other.ply" in session.messages.log[-1].text
    session.close()


def test_an_error_without_a_terminal_or_a_desktop_is_no_second_error(monkeypatch):
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(sys, "stderr", None)
    desktop.show_error("nothing works")


def test_the_command_is_imported_within_a_tenth_of_a_second():
    command = (
        "import sys, time; start = time.perf_counter(); import instdrive_app.main; print(time.perf_counter() - start)"
    )
    heavy = "print(*sorted({'numpy', 'tyro', 'torch', 'imgui_bundle', 'instdrive_core'} & set(sys.modules)))"
    runs = [
        subprocess.run([sys.executable, "-c", f"{command}; {heavy}"], capture_output=True, text=True, check=True)
        for _ in range(5)
    ]
    assert min(float(run.stdout.split("\n")[0]) for run in runs) <= 0.1
    assert runs[0].stdout.split("\n")[1] == ""
