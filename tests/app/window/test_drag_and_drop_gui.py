"""Files dragged from another program onto the real window, over the X protocol."""

import shutil

import numpy as np
import pytest
from procedural_street import FIRST_CAR, procedural_street
from window_driver import editor_window
from xdnd_source import drop_source

from instdrive_core.formats.registry import save_scene
from instdrive_core.scene.scene import scene_from_gaussians

pytestmark = pytest.mark.gui

HARD_NAME = "Größe 50% (a&b) %s%20 машина.ply"
PLACE = (500, 300)
"""Somewhere in the window."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with the street as a folder, a car as files of many names, and what is no scene; tests only read it."""
    folder, street = tmp_path_factory.mktemp("with spaces, ä"), procedural_street()
    save_scene(folder / "street run", street)
    save_scene(folder / "car.ply", one_car(street))
    for name in (HARD_NAME, "van.ply", "caf\udce9.ply"):
        shutil.copy(folder / "car.ply", folder / name)
    (folder / "notes.txt").write_text("ply\nno scene")
    (folder / "broken.ply").write_bytes(b"ply\nformat ascii 1.0\nnonsense")
    (folder / "empty folder").mkdir()
    return folder


def one_car(street):
    rows = np.flatnonzero(street.instance_ids == FIRST_CAR + 4)
    return scene_from_gaussians(street.gaussians.select(rows))


@pytest.fixture
def source(window):
    """Another program on the window's display."""
    with drop_source() as made:
        yield made


@pytest.fixture
def empty_window(files, tmp_path):
    """The window with nothing open: what it was started with cannot be read."""
    with editor_window(files / "broken.ply", tmp_path, opens=False) as driver:
        driver.wait_for_widget("empty.open")
        yield driver


def test_what_is_dropped_onto_an_empty_window_is_opened(empty_window, files):
    with drop_source() as source:
        assert source.drop([files / "street run"], PLACE)
        empty_window.wait_for_message("Opened street run")
        assert empty_window.wait_until_open()["history"] == []
        assert empty_window.quit() == 0


def test_of_several_files_the_first_is_opened_and_the_others_are_told(empty_window, files):
    with drop_source() as source:
        assert source.drop([files / name for name in ("notes.txt", HARD_NAME, "van.ply", "car.ply")], PLACE)
        empty_window.wait_for_message(f"Opened {HARD_NAME}")
        state = empty_window.wait_for_message("Left out: van.ply and car.ply")
        assert "notes.txt is not a scene or project that can be opened" in state["messages"]
        assert empty_window.quit() == 0


def test_one_file_is_opened_or_inserted_as_the_user_says(window, source, files):
    car = files / HARD_NAME
    assert source.drop([car], PLACE)
    window.click_widget("question.Cancel")
    assert window.wait_until_calm()["history"] == []
    assert source.drop([car], PLACE)
    window.click_widget("question.Insert")
    state = window.wait_for_edit(f"Insert {HARD_NAME}")
    assert len(state["selected"]) == 1

    assert source.drop([car], PLACE)
    window.click_widget("question.Open")
    window.wait_for_widget("question.Don't save")
    assert source.drop([files / "van.ply"], PLACE)
    state = window.wait_for_message("Please close the open dialog")
    assert "question.Don't save" in state["widgets"], "what is asked stays asked"
    window.click_widget("question.Cancel")
    assert window.wait_until_calm()["unsaved"], "nothing is lost unasked"

    assert source.drop([car], PLACE)
    window.click_widget("question.Open")
    window.click_widget("question.Don't save")
    window.wait_for(lambda state: state.get("history") == [], "the other scene")
    assert window.quit() == 0


def test_several_files_are_inserted_side_by_side_and_what_cannot_be_is_told(window, source, files):
    dropped = [files / name for name in ("car.ply", "notes.txt", "broken.ply", HARD_NAME, "van.ply")]
    assert source.drop(dropped, PLACE)
    window.click_widget("question.Insert")
    state = window.wait_for_edit("Insert van.ply")
    assert state["history"] == ["Insert car.ply", f"Insert {HARD_NAME}", "Insert van.ply"]
    assert len(state["selected"]) == 3, "all are taken in hand"
    told = "\n".join(state["messages"])
    assert "notes.txt is not a scene" in told
    assert f"{files / 'broken.ply'}: " in told
    assert window.quit() == 0


def test_what_cannot_be_opened_is_told_and_the_window_lives(window, source, files):
    expected = {
        files / "notes.txt": "notes.txt is not a scene or project",
        files / "empty folder": "The folder empty folder contains no scene",
        files / "nothing.ply": f"{files / 'nothing.ply'} was not found",
        files / ("x" * 300 + ".ply"): "x.ply was not found",
        files / "caf\udce9.ply": "caf\ufffd.ply cannot be opened: its path is not UTF-8 text",
    }
    for path, told in expected.items():
        assert source.drop([path], PLACE)
        window.wait_for_message(told)
    assert source.drop_data(b"https://example.org/street.ply\r\n", PLACE)
    window.wait_for_message("https://example.org/street.ply is not on this computer")
    assert not source.drop_data(b"some text", PLACE, "text/plain"), "the window takes files only"
    assert source.drag_past(PLACE)

    # Whatever a bad name has left behind would be raised by now: pictures are drawn, titles and scenes changed.
    window.click_widget(f"instances.{FIRST_CAR}")
    window.key("Delete")
    state = window.wait_for(lambda state: FIRST_CAR not in state["visible"] and state["settled"], "a new picture")
    assert "question.Open" not in state["widgets"]
    assert window.quit() == 0


def test_paths_that_are_typed_or_listed_may_be_odd_too(window, tmp_path):
    """Names that are dropped may be odd; so may these."""
    for name in (HARD_NAME, "caf\udce9.ply"):
        (tmp_path / name).touch()
    window.key("ctrl+o")
    window.wait_for_widget("dialog.path")
    for typed in ("~nobody/a", f"{tmp_path}/"):
        window.key("ctrl+a")
        window.type(typed)
        window.wait_until_calm()
    listed = window.wait_for(lambda state: f"browser.{HARD_NAME}" in state["widgets"], "the folder's list")["widgets"]
    assert not any("caf" in name for name in listed), "a name that cannot be shown"
    window.click_widget("dialog.cancel")
    assert window.quit() == 0
