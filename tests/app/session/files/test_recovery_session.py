"""Recovering what a dead editor has left, as the window's dialogs do it."""

import time

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, OTHER_CAR, ROAD, parked_street
from procedural_street import FIRST_CAR, procedural_street
from session_driver import errors, finish

from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskChangedScene, OfferRecovery
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import save_scene


@pytest.fixture
def left_behind(tmp_path, monkeypatch):
    """The path of a scene, whose editor died after an edit."""
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path / "state"))
    path = tmp_path / "street"
    save_scene(path, procedural_street())
    editor = EditorSession()
    editor.files.open(path)
    finish(editor)
    editor.deletion.delete((FIRST_CAR,))
    editor.tick(0.0)
    journals, end = tmp_path / "state" / "recovery", time.monotonic() + 60
    while not any("delete_instances" in journal.read_text() for journal in journals.glob("*/*.jsonl")):
        assert time.monotonic() < end, list(journals.glob("*/*"))
        time.sleep(0.01)
    editor.close(by_choice=False)
    editor.files.autosave._recovery._lock.release()
    return path


def test_of_a_changed_scene_it_is_asked_and_can_be_had_all_the_same(left_behind):
    scene = procedural_street()
    scene.gaussians.means[0, 0] += 1
    save_scene(left_behind, scene)
    editor = EditorSession()
    editor.files.offer_recovery()
    finish(editor)
    assert editor.requests.waiting == (OfferRecovery(),)
    (session,) = editor.files.autosave.recoverable
    editor.files.recover(session)
    finish(editor)
    changed = editor.requests.take(AskChangedScene)
    assert editor.document is None
    assert errors(editor) == []
    assert str(left_behind) in changed.reason
    changed.open_anyway()
    finish(editor)
    assert FIRST_CAR not in editor.document.find_visible_instances()
    assert editor.files.is_unsaved
    assert editor.files.autosave.recoverable == []
    editor.close()


def test_holes_of_a_killed_editor_are_offered_after_recovery(tmp_path, monkeypatch):
    """Two deletions, the first hole filled: the recovered document offers the second hole only."""
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path / "state"))
    path = tmp_path / "parked"
    document = Document(parked_street().scene)
    away = np.abs(document.scene.gaussians.means[:, :2] - CAR_CENTER[:2] - [0, 6.5])  # the other car hides ground, too
    hidden = np.isin(document.scene.instance_ids, (ROAD, 2)) & (away < CAR_SIZE[:2] / 2).all(axis=1)
    document.apply(DeleteRows(np.flatnonzero(hidden)))
    save_scene(path, bake_document(document))
    editor = EditorSession()
    editor.files.open(path)
    finish(editor)
    for number in (CAR, OTHER_CAR):
        editor.deletion.delete((number,))
        finish(editor)
    assert len([found for found in editor.deletion.review.pending if found.holes]) == 2
    editor.deletion.review.fill()
    finish(editor)
    editor.tick(0.0)
    journals, end = tmp_path / "state" / "recovery", time.monotonic() + 60
    while not any("fill_hole" in journal.read_text() for journal in journals.glob("*/*.jsonl")):
        assert time.monotonic() < end, list(journals.glob("*/*"))
        time.sleep(0.01)
    editor.close(by_choice=False)
    editor.files.autosave._recovery._lock.release()

    again = EditorSession()
    again.files.offer_recovery()
    finish(again)
    (session,) = again.files.autosave.recoverable
    again.files.recover(session)
    finish(again)
    (left,) = [found for found in again.deletion.review.pending if found.holes]
    assert left.deletion.ids == (CAR,)
    again.deletion.review.fill_all()
    finish(again)
    assert not [found for found in again.deletion.review.pending if found.holes]
    again.close()
