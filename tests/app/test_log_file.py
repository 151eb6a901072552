"""The log on disk."""

import logging
import threading
import warnings

import pytest
from log_handlers import stop_logging

from instdrive_app import log_file
from instdrive_app.log_file import get_log_path, start_logging
from instdrive_core.files.user_folders import find_state_folder


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.setattr(threading, "__excepthook__", lambda _: None)
    path = tmp_path / "logs" / "editor.log"
    handler = start_logging(path)
    assert handler is not None
    yield path
    stop_logging(handler)


def test_the_log_lies_in_the_state_folder():
    assert get_log_path().parent.parent == find_state_folder()


def test_failures_in_threads_and_warnings_are_kept(log):
    def fail():
        raise ZeroDivisionError("beside the window")

    thread = threading.Thread(target=fail, name="aside")
    thread.start()
    thread.join()
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.warn("something is old", stacklevel=1)
    logging.getLogger("instdrive_core.formats").info("read")
    text = log.read_text(encoding="utf-8")
    assert "aside failed" in text
    assert "ZeroDivisionError: beside the window" in text
    assert "in fail" in text, "the traceback is there"
    assert "read" in text
    assert "something is old" in text


def test_failures_with_names_that_are_no_text_are_kept(log):
    logging.getLogger("instdrive_app").error("%s is damaged", "street\udcff.ply")
    assert r"street\udcff.ply is damaged" in log.read_text(encoding="utf-8")


def test_logs_are_rotated(tmp_path, monkeypatch):
    monkeypatch.setattr(log_file, "MAX_BYTES", 2000)
    handler = start_logging(tmp_path / "editor.log")
    assert handler is not None
    for number in range(400):
        logging.getLogger("instdrive_app").warning("line %d of many", number)
    stop_logging(handler)
    files = sorted(file.name for file in tmp_path.iterdir())
    assert files == ["editor.log", *(f"editor.log.{number}" for number in range(1, log_file.BACKUPS + 1))]
    assert all(file.stat().st_size <= 2000 for file in tmp_path.iterdir())
    assert "line 399" in (tmp_path / "editor.log").read_text()


def test_a_log_that_cannot_be_written_is_told_and_gone_without(tmp_path, capsys):
    (tmp_path / "logs").write_bytes(b"a file where the folder should be")
    assert start_logging(tmp_path / "logs" / "editor.log") is None
    assert "cannot be written" in capsys.readouterr().err
