"""Two editors that have one project open: neither loses the other's work without being asked."""

import pytest
from procedural_street import FIRST_CAR, HOUSES, ROAD
from session_driver import errors, finish

from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskOtherSave


@pytest.fixture
def project(street_folder, tmp_path, monkeypatch):
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path / "state"))
    return tmp_path / "street.instdrive"


def open_editor(path):
    editor = EditorSession()
    editor.files.open(path)
    finish(editor)
    return editor


def test_a_project_saved_elsewhere_is_written_over_only_when_asked(street_folder, project):
    first = open_editor(street_folder)
    first.files.save(project)
    finish(first)
    second = open_editor(project)
    for instance in (ROAD, HOUSES):  # of an editor's own, two saves in a row are no news
        first.visibility.hide((instance,))
        first.files.save()
        first.files.save()
    finish(first)
    assert first.requests.waiting == ()
    second.visibility.hide((FIRST_CAR,))
    left = []
    second.files.save(then=lambda: left.append(True))
    finish(second)
    asked = second.requests.take(AskOtherSave)
    assert asked.path == project
    assert second.files.is_unsaved
    assert not left, "the window stays open"
    assert errors(second) == []
    kept = open_editor(project)
    assert ROAD not in kept.document.find_visible_instances(), "the first editor's save is there still"
    asked.save_over()
    finish(second)
    assert left
    assert not second.files.is_unsaved
    last = open_editor(project)
    assert FIRST_CAR not in last.document.find_visible_instances()
    assert ROAD in last.document.find_visible_instances()
    project.unlink()
    second.visibility.show_all()
    second.files.save()
    finish(second)
    assert project.exists(), "what is gone is no other editor's"
    for editor in (first, second, kept, last):
        editor.close()
