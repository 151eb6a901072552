"""Projects give back the document that was saved, wherever they and their scenes are moved, and never another one."""

import json
import shutil
import zipfile

import numpy as np
import pytest
from document_snapshot import snapshot
from project_cases import VIEW, assert_same_document, edited_document, rewrite_json, saved_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.errors import DataError, EditError, SceneChangedError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.project.open import open_document, open_edited_scene, open_project
from instdrive_core.project.save import capture_project_state, save_project, write_project


@pytest.fixture
def saved(tmp_path, monkeypatch):
    """A document and the project it was saved to, in a folder beside its scene's. Its photos lie in no folder that
    moves, wherever the tests are run."""
    monkeypatch.chdir(tmp_path.anchor)
    (tmp_path / "scenes").mkdir()
    document = edited_document(tmp_path / "scenes")
    path = tmp_path / "projects" / "a.instdrive"
    save_project(path, document, VIEW)
    return document, path


def test_a_project_gives_back_document_history_and_view(saved):
    document, path = saved
    again, view = open_document(path)
    assert view == VIEW
    assert_same_document(document, again)
    again.redo()
    again.apply(RenameInstance(3, "tram"))
    assert [edit.title for edit in again.history.edits][-2:] == ["Delete instance 1", "Rename instance 3 to tram"]


def test_saving_again_from_the_reopened_project_keeps_everything(saved, tmp_path):
    document, path = saved
    again, view = open_document(path)
    save_project(tmp_path / "elsewhere" / "deep" / "b.instdrive", again, view)
    assert_same_document(document, open_document(tmp_path / "elsewhere" / "deep" / "b.instdrive")[0])


def test_long_lists_of_rows_are_arrays_and_short_ones_json(saved):
    with zipfile.ZipFile(saved[1]) as archive:
        assert "arrays/0.safetensors" in archive.namelist()
        lines = archive.read("edits.jsonl").decode().splitlines()
    assert max(map(len, lines)) < 500
    assert json.loads(lines[0]) == {"kind": "select_instances", "ids": [2], "mode": "replace"}


def test_a_plain_scene_opens_without_a_view(tmp_path):
    document, view = open_document(saved_scene(tmp_path))
    assert view is None
    assert document.history.edits == ()
    assert document.open_scene is not None


def test_what_was_taken_is_written_though_the_document_goes_on(saved, tmp_path):
    document, _ = saved
    before, state = snapshot(document), capture_project_state(document)
    document.apply(DeleteInstances((6,)))
    write_project(tmp_path / "b.instdrive", state)
    assert snapshot(open_document(tmp_path / "b.instdrive")[0]) == before


# Where scenes are


@pytest.mark.parametrize("layout", ["together", "project", "flat"])
def test_scenes_are_found_after_a_move(saved, tmp_path, layout):
    document, path = saved
    before = snapshot(document)
    away = tmp_path / "away"
    if layout == "together":
        shutil.move(tmp_path / "scenes", away / "scenes")
        path = shutil.move(path.parent, away / "projects") / path.name
    elif layout == "project":
        away.mkdir()
        path = shutil.move(path, away / "a.instdrive")
    else:
        path = shutil.move(tmp_path / "projects", away) / path.name
        for name in ("street", "car"):
            shutil.move(tmp_path / "scenes" / name, away / name)
    again, _ = open_document(path)
    assert snapshot(again) == before
    save_project(away / "b.instdrive", again)
    assert snapshot(open_document(away / "b.instdrive")[0]) == before


def test_a_scene_that_is_nowhere_is_asked_for(saved, tmp_path):
    shutil.rmtree(tmp_path / "scenes" / "street")
    with pytest.raises(DataError, match=r"needs is not at .*street.*Put it back"):
        open_document(saved[1])


def test_an_equal_copy_is_preferred_to_a_changed_original(saved, tmp_path):
    document, path = saved
    before = snapshot(document)
    shutil.copytree(tmp_path / "scenes" / "street", path.parent / "street")
    save_scene(tmp_path / "scenes" / "street", open_scene(tmp_path / "scenes" / "car"))
    assert snapshot(open_document(path)[0]) == before


@pytest.mark.parametrize("changed", ["street", "car"])
def test_a_changed_scene_is_named_with_both_hashes_and_opened_on_demand(saved, tmp_path, changed):
    document, path = saved
    scene = open_scene(tmp_path / "scenes" / changed)
    scene.gaussians.means[0] += 1
    save_scene(tmp_path / "scenes" / changed, scene)
    with pytest.raises(SceneChangedError, match="accept_changed") as caught:
        open_document(path)
    assert caught.value.scene.name == changed
    assert caught.value.expected in str(caught.value)
    assert caught.value.found in str(caught.value)
    project = open_project(path, accept_changed=True)
    if changed == "street":
        assert project.document.history.cursor == document.history.cursor
    else:
        assert len(project.notes) == 1
        assert "edit 3 of the history" in project.notes[0]
        assert "Insert car" not in [edit.title for edit in project.document.history.edits]


def test_edits_that_no_longer_fit_are_left_out_on_demand_only(saved, tmp_path):
    document, path = saved
    save_scene(tmp_path / "scenes" / "street", open_scene(tmp_path / "scenes" / "car"))
    project = open_project(path, accept_changed=True)
    assert project.notes
    assert len(project.document.history.edits) == len(document.history.edits) - len(project.notes)
    assert project.document.history.cursor <= document.history.cursor


def test_a_scene_replaced_under_an_open_document_does_not_pass_for_the_edited_one(saved, tmp_path):
    document, path = saved
    save_scene(tmp_path / "scenes" / "street", open_scene(tmp_path / "scenes" / "car"))
    save_project(path, document)
    with pytest.raises(SceneChangedError):
        open_document(path)


def test_another_result_than_when_saved_is_noted(saved):
    assert open_project(saved[1]).notes == ()
    rewrite_json(saved[1], "manifest.json", lambda manifest: manifest["check"].update(flags=1))
    assert "another result" in open_project(saved[1]).notes[0]


def test_documents_from_nowhere_and_odd_names_are_refused(saved, tmp_path):
    scene = open_scene(tmp_path / "scenes" / "street")
    with pytest.raises(DataError, match="comes from no file"):
        save_project(tmp_path / "b.instdrive", Document(scene))
    with pytest.raises(DataError, match=r"NAME\.instdrive"):
        save_project(tmp_path / "b.zip", saved[0])
    for view in ({"x": float("nan")}, {"x": np.zeros(3)}):
        with pytest.raises(DataError, match="view cannot be kept"):
            save_project(tmp_path / "b.instdrive", saved[0], view)
    assert not (tmp_path / "b.instdrive").exists()


def test_a_project_opens_as_the_scene_that_its_edits_make(saved):
    scene = open_edited_scene(saved[1])
    assert 2 not in scene.table
    assert len(scene) == int((saved[0].state.flags & 8 == 0).sum())


def test_a_newer_file_of_a_recorded_name_can_be_inserted(saved, tmp_path):
    again, _ = open_document(saved[1])
    save_scene(tmp_path / "scenes" / "car", open_scene(tmp_path / "scenes" / "street"))
    again.apply(InsertScene(str(tmp_path / "scenes" / "car")))
    assert len(again.scene) == 2 * 6000 + 15
    shutil.rmtree(tmp_path / "scenes" / "car")
    again.undo()
    assert again.redo() is not None


def test_an_insert_that_fails_leaves_the_document_as_it_was(saved, tmp_path):
    document = saved[0]
    before = snapshot(document)
    with pytest.raises((DataError, EditError)):
        document.apply(InsertScene(str(tmp_path / "absent.ply")))
    assert snapshot(document) == before
