"""Parts of the panels that need no window."""

from pathlib import Path

import numpy as np
import pytest

from instdrive_app.cli import edit as edit_command
from instdrive_app.files import sample
from instdrive_app.files.folder_listing import list_folder
from instdrive_app.panels.dialogs.file_browser import has_desktop_dialogs
from instdrive_app.panels.dialogs.file_purposes import PURPOSES, holds_scene
from instdrive_app.panels.instances.rows import matches
from instdrive_app.shell.window import require_display
from instdrive_app.timeline import Timeline
from instdrive_core.errors import InstDriveError
from instdrive_core.formats.folder.scenes import MANIFEST
from instdrive_core.instances.table import Instance
from instdrive_core.scene.camera import Camera, CameraView


def test_the_file_browser_lists_folders_and_scenes(tmp_path):
    for name in ("a.ply", "notes.txt", ".hidden.ply", "Z.PLY", "b.splat", "c.compressed.ply"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "run").mkdir()
    found = list_folder(tmp_path, PURPOSES["open"].suffixes, holds_scene)
    assert [entry.path.name for entry in found] == ["run", "a.ply", "b.splat", "c.compressed.ply", "Z.PLY"]
    assert [entry.is_scene for entry in found] == [False, True, True, True, True]
    (tmp_path / "b.splat").write_bytes(b"x" * 4_200_000)
    sizes = {entry.path.name: entry.size_text for entry in list_folder(tmp_path, (".splat",), holds_scene)}
    assert sizes == {"run": "", "b.splat": "4.2 MB"}
    assert list_folder(tmp_path / "nowhere", (".ply",), holds_scene) == []


def test_paths_are_judged_before_they_are_used(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"")
    (tmp_path / "run").mkdir()
    opened, exported, saved = (PURPOSES[name].find_problem for name in ("open", "export", "save"))
    assert not opened(tmp_path / "a.ply")
    assert opened(tmp_path / "run")
    (tmp_path / "run" / MANIFEST).write_text("{}")
    assert not opened(tmp_path / "run")
    for name in ("new.ply", "new.compressed.ply", "new.SPLAT", "new_run"):
        assert not exported(tmp_path / name)
    assert ".ply" in exported(tmp_path / "new.obj")
    assert "does not exist" in exported(tmp_path / "nowhere" / "new.ply")
    assert "file name" in exported(tmp_path)
    assert not saved(tmp_path / "new.instdrive")
    assert ".instdrive" in saved(tmp_path / "new.ply")
    assert ".instdrive" in saved(tmp_path / "new")


@pytest.mark.parametrize(("tools", "expected"), [((), False), (("zenity",), True), (("kdialog",), True)])
def test_desktop_dialogs_need_their_program(monkeypatch, tools, expected):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("shutil.which", lambda name: name if name in tools else None)
    assert has_desktop_dialogs() is expected


@pytest.mark.parametrize(
    ("search", "found"), [("", True), ("CAR", True), ("17", True), ("red car", True), ("tree", False)]
)
def test_search_takes_every_word(search, found):
    assert matches(Instance(17, "red taxi", class_name="Car"), search.lower().split()) is found


def test_a_timeline_without_cameras_takes_the_tracks_moments():
    assert Timeline(()).steps == ()
    assert Timeline(()).find_step(3.0) == 0
    with pytest.raises(ValueError, match="no camera 'front'"):
        Timeline(()).find_nearest_view("front", 0.0)


def test_cameras_that_are_not_triggered_together_share_their_steps():
    eye = Camera(10.0, 10.0, 5.0, 5.0, 10, 10, np.eye(4))
    names = ("front", "left", "right")
    views = [
        CameraView(eye, name, index, 0.1 * index + 0.03 * order)
        for index in range(4)
        for order, name in enumerate(names)
    ]
    timeline = Timeline(views)
    assert timeline.steps == pytest.approx((0.03, 0.13, 0.23, 0.33))
    for name in names:
        view, seen = timeline.find_nearest_view(name, timeline.start), []
        for _ in range(5):
            seen.append(views[view].index)
            view = timeline.find_nearest_view(name, timeline.step_time(views[view].time, 1))
        assert seen == [0, 1, 2, 3, 0], "onwards with the dataset camera, and around the end"


def test_missing_scenes_and_displays_are_explained(monkeypatch):
    monkeypatch.setattr(sample, "SAMPLE", "no_such_scene")
    with pytest.raises(InstDriveError, match="instdrive edit SCENE"):
        edit_command.edit()
    with pytest.raises(InstDriveError, match="no such file"):
        edit_command.edit(Path("missing.ply"))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InstDriveError, match="xvfb-run"):
        require_display()
