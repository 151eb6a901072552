"""Recording from a session: what the command gets, what the user is told, and which folders are taken."""

import numpy as np
import pytest
from session_driver import errors, finish
from small_clip import write_small_clip

from instdrive_app.session.making.drive_recorder import (
    LAYOUTS,
    RecordChoice,
    find_folder_problem,
    is_begun,
)
from instdrive_core.cli.recording.simulate import Layout
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.project.open import open_document
from instdrive_core.recording.ego_path import find_ego_way, parse_ego_change
from instdrive_core.recording.folder import read_manifest


@pytest.fixture
def recorder(session, street_folder):
    """The recorder of a session that shows the street."""
    document, _ = open_document(street_folder)
    session.show(document, street_folder)
    return session.recorder


def test_the_dialog_offers_what_the_command_takes():
    assert set(LAYOUTS) == set(Layout.__args__)


@pytest.mark.parametrize("way", ["shift", "lane", "speed", "stop"])
def test_every_way_is_one_of_the_command(way):
    arguments = RecordChoice(way=way, amount=0.5).list_arguments()
    assert parse_ego_change(arguments[arguments.index("--ego") + 1]).kind == way


def test_choices_become_arguments():
    assert RecordChoice().list_arguments() == []
    other = RecordChoice(shutter=0.03, rig=" rig.json ", video="mp4", flow=True)
    assert other.list_arguments() == ["--shutter", "0.03", "--rig", "rig.json", "--video", "mp4"]
    file = RecordChoice(way="file", way_file=" drive.xosc#Ego ", exr=True, lidar="VLP-16", ray_drop=True)
    ego, depth = ["--ego", "path=drive.xosc#Ego"], ["--depth-format", "exr"]
    assert file.list_arguments() == [*ego, *depth, "--lidar", "VLP-16", "--ray-drop"]
    assert RecordChoice(lidar="none", ray_drop=True).list_arguments() == ["--lidar", "none"]
    chosen = RecordChoice(width=64, flow=True, confidence=True, layouts=("coco", "t4"))
    assert chosen.list_arguments() == ["--width", "64", "--flow", "--confidence", "--layout", "coco", "t4"]


def test_the_drive_is_recorded_as_edited_and_told(recorder, session, tmp_path):
    gone = next(iter(session.document.scene.table)).id
    session.history.apply(DeleteInstances((gone,)))
    recorder.begin(tmp_path / "out", RecordChoice(width=64))
    assert recorder.is_running
    finish(session)
    assert not errors(session)
    assert session.messages.log[-1].text.startswith(f"Recorded {tmp_path / 'out'}, ")
    manifest = read_manifest(tmp_path / "out")
    assert gone not in {entry["id"] for entry in manifest["instances"]}
    assert {view["width"] for view in manifest["views"]} == {64}
    assert is_begun(str(tmp_path / "out"))
    assert not find_folder_problem(str(tmp_path / "out"))

    recorder.begin(tmp_path / "out", RecordChoice(width=32))
    finish(session)
    assert "another scene, or of other views" in errors(session)[-1]


def test_a_drawn_way_is_recorded(recorder, session, tmp_path):
    before = find_ego_way(session.document.scene.views)
    x, y = before.world_from_box[0, :2, 3].tolist()
    for step in range(3):
        session.ego_way.add(x - 0.5 * step, y + 2.0 * step)
    choice = RecordChoice(width=32, way="drawn", amount=2.0)
    assert choice.list_arguments() == ["--width", "32"]
    recorder.begin(tmp_path / "out", choice)
    finish(session)
    assert not errors(session)
    views = [view for view in read_manifest(tmp_path / "out")["views"] if view["camera"] == "front_camera"]
    places = np.array([view["world_from_camera"] for view in views])[:, :2, 3]
    np.testing.assert_allclose(places[0], (x, y), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(np.diff(places, axis=0), axis=1), 2.0 * 0.5, atol=0.03)
    assert places[-1, 0] < x - 0.3


def test_folders_that_cannot_take_a_recording_are_refused(tmp_path):
    (tmp_path / "file").write_text("x")
    clip = write_small_clip(tmp_path / "clip")
    assert find_folder_problem("  ") == "Name a folder"
    assert "is a file" in find_folder_problem(str(tmp_path / "file"))
    assert "something else" in find_folder_problem(str(clip))
    assert not find_folder_problem(str(tmp_path / "new"))
