"""What an editor that died leaves is offered to the next one, whole up to the last line that is."""

import json
import os
import signal
import subprocess
import sys
import time
import zlib
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from document_snapshot import snapshot
from project_cases import assert_same_document, edited_document, saved_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteSelected
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.errors import DataError, SceneChangedError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.project import recovery as recovery_module
from instdrive_core.project.open import open_document
from instdrive_core.project.recoverable import discard_session, find_pending_sessions, restore_session
from instdrive_core.project.recovery import Recovery
from instdrive_core.project.save import capture_project_state, save_project
from instdrive_core.project.session_folder import JOURNAL, LOCK, SESSION


@pytest.fixture
def root(tmp_path, monkeypatch):
    """Where sessions are, with an autosave that need not be waited for."""
    monkeypatch.setattr(recovery_module, "WRITE_INTERVAL", 0.01)
    monkeypatch.setattr(recovery_module, "SYNC_INTERVAL", 0.02)
    return tmp_path / "state" / "recovery"


@pytest.fixture
def started(tmp_path, root):
    """A document of a scene called ``street`` and its journal."""
    path = saved_scene(tmp_path, count=6000)
    document, _ = open_document(path)
    recovery = Recovery.begin(document, path, root=root)
    yield document, recovery
    recovery.end()


def die(recovery):
    """What is left of an editor whose process is gone: its folder, unlocked."""
    recovery.flush()
    recovery._stop()
    recovery._lock.release()


def do(document, recovery, *edits):
    for edit in edits:
        document.apply(edit)
        recovery.record()


def test_the_document_of_a_dead_editor_is_offered_and_restored(tmp_path, root):
    document = edited_document(tmp_path)
    recovery = Recovery.begin(document, tmp_path / "street", root=root)
    do(document, recovery, RenameInstance(3, "tram"), SelectInstances((4,)))
    document.undo()
    recovery.record()
    die(recovery)
    (session,) = find_pending_sessions(root)
    assert (session.title, session.path, session.edits) == ("street", tmp_path / "street", 1)
    assert abs(datetime.now().astimezone() - session.changed) < timedelta(minutes=1)
    restored = restore_session(session)
    assert restored.notes == ()
    assert_same_document(document, restored.document)


def test_a_restored_document_is_offered_again_until_it_is_saved(tmp_path, root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    die(recovery)
    (session,) = find_pending_sessions(root)
    restored = restore_session(session)
    second = Recovery.begin(restored.document, restored.path, restored=restored, root=root)
    second.flush()
    assert not session.folder.exists()
    die(second)
    (session,) = find_pending_sessions(root)
    assert session.edits == 1
    restored = restore_session(session)
    third = Recovery.begin(restored.document, restored.path, restored=restored, root=root)
    state = capture_project_state(restored.document)
    save_project(tmp_path / "a.instdrive", restored.document)
    third.mark_saved(tmp_path / "a.instdrive", state)
    die(third)
    assert find_pending_sessions(root) == []


def test_sessions_that_run_are_not_offered_and_ended_ones_are_gone(root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    recovery.flush()
    assert find_pending_sessions(root) == []
    assert recovery.folder.exists()
    recovery.end()
    assert list(root.iterdir()) == []
    assert find_pending_sessions(root) == []


def test_selecting_is_no_work(root, started):
    document, recovery = started
    do(document, recovery, SelectInstances((2,)), SelectRows(np.arange(0, 6000, 2)))
    die(recovery)
    assert find_pending_sessions(root) == []
    assert list(root.iterdir()) == [], "nothing would be lost with it"


def test_only_what_was_done_since_saving_counts(tmp_path, root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)), RenameInstance(3, "tram"))
    state = capture_project_state(document)
    save_project(tmp_path / "a.instdrive", document)
    do(document, recovery, DeleteInstances((4,)))  # while it was being written
    recovery.mark_saved(tmp_path / "a.instdrive", state)
    die(recovery)
    (session,) = find_pending_sessions(root)
    assert (session.title, session.edits) == ("a.instdrive", 1)
    assert snapshot(restore_session(session).document) == snapshot(document)


def test_undoing_what_was_saved_is_a_change_and_redoing_it_is_none(tmp_path, root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    recovery.mark_saved(tmp_path / "a.instdrive", capture_project_state(document))
    document.undo()
    recovery.record()
    recovery.flush()
    die(recovery)
    (session,) = find_pending_sessions(root)
    assert session.edits == 1
    restored = restore_session(session)
    assert restored.document.history.cursor == 0
    assert restored.document.redo() is not None
    restored.remove()


def test_a_saved_state_that_was_edited_away_counts_as_unsaved(tmp_path, root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    state = capture_project_state(document)
    document.undo()
    do(document, recovery, RenameInstance(3, "tram"))
    recovery.mark_saved(tmp_path / "a.instdrive", state)
    die(recovery)
    assert [session.edits for session in find_pending_sessions(root)] == [1]


def test_two_editors_do_not_restore_the_same_session(root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    die(recovery)
    (session,) = find_pending_sessions(root)
    restored = restore_session(session)
    with pytest.raises(DataError, match="another editor has taken"):
        restore_session(session)
    with pytest.raises(DataError, match="another editor has taken"):
        discard_session(session)
    assert find_pending_sessions(root) == []
    restored.remove()
    with pytest.raises(DataError, match="another editor has taken"):
        restore_session(session)


def test_a_session_can_be_discarded(root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    die(recovery)
    (session,) = find_pending_sessions(root)
    discard_session(session)
    assert find_pending_sessions(root) == []
    assert not session.folder.exists()


def test_closing_a_restored_document_at_once_leaves_nothing(root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    die(recovery)
    restored = restore_session(find_pending_sessions(root)[0])
    Recovery.begin(restored.document, restored.path, restored=restored, root=root).end()
    assert list(root.iterdir()) == []


def test_an_editor_that_dies_before_the_new_session_is_whole_leaves_the_old_one(root, started, monkeypatch):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    die(recovery)
    restored = restore_session(find_pending_sessions(root)[0])

    def full(folder, path, base):
        raise DataError(folder, "the file cannot be written (No space left on device)", "Free some space")

    monkeypatch.setattr(recovery_module, "write_session", full)
    second = Recovery.begin(restored.document, restored.path, restored=restored, root=root)
    with pytest.raises(DataError, match="No space left"):
        second.flush()
    second._stop()
    second._lock.release()
    restored._lock.release()
    (session,) = find_pending_sessions(root)
    assert snapshot(restore_session(session).document) == snapshot(document)


# The journal


@pytest.mark.parametrize("damage", ["torn", "zeros", "flipped", "not json"])
def test_a_damaged_end_is_dropped_and_all_before_it_kept(root, started, damage):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    recovery.flush()
    before = snapshot(document)
    whole = (recovery.folder / JOURNAL).read_bytes()
    do(document, recovery, RenameInstance(3, "tram"))
    recovery.flush()
    do(document, recovery, RenameInstance(4, "bus"))
    die(recovery)
    tail = (recovery.folder / JOURNAL).read_bytes()[len(whole) :]
    tail = {
        "torn": tail[: tail.index(b"\n")],
        "zeros": b"\0" * len(tail),
        "flipped": tail.replace(b"tram", b"tran"),
        "not json": b"hello\n" + tail,
    }[damage]
    (recovery.folder / JOURNAL).write_bytes(whole + tail)
    (session,) = find_pending_sessions(root)
    assert session.edits == 1
    assert snapshot(restore_session(session).document) == before


def test_a_drag_is_a_few_lines(root, started, monkeypatch):
    monkeypatch.setattr(recovery_module, "WRITE_INTERVAL", 0.1)
    document, recovery = started
    for step in range(300):
        document.apply(RecolorInstances((2,), "solid", (step / 300, 0.0, 0.0)), gesture="drag")
        recovery.record()
    die(recovery)
    assert len((recovery.folder / JOURNAL).read_bytes().splitlines()) < 25
    (session,) = find_pending_sessions(root)
    assert snapshot(restore_session(session).document) == snapshot(document)
    assert session.edits == 1


def test_nothing_new_writes_nothing(started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    recovery.flush()
    size = (recovery.folder / JOURNAL).stat().st_size
    for _ in range(5):
        recovery.record()
    recovery.flush()
    assert (recovery.folder / JOURNAL).stat().st_size == size


def test_long_lists_and_inserted_files_come_back(tmp_path, root, started, monkeypatch):
    document, recovery = started
    saved_scene(tmp_path, "car", seed=1, count=15, instances=2, actors=1)
    monkeypatch.chdir(tmp_path)
    rows = np.flatnonzero(np.random.default_rng(0).random(6000) < 0.5)
    do(document, recovery, InsertScene("car"), SelectRows(rows), DeleteSelected())
    monkeypatch.chdir("/")
    die(recovery)
    (session,) = find_pending_sessions(root)
    restored = restore_session(session)
    assert_same_document(document, restored.document)
    # From here it is a project like any other.
    save_project(tmp_path / "p" / "a.instdrive", restored.document)
    assert_same_document(document, open_document(tmp_path / "p" / "a.instdrive")[0])


def test_a_full_disk_is_told_once_and_made_up_for(root, started, monkeypatch):
    document, recovery = started
    true_write = os.write

    def half_a_line(descriptor, data):
        if len(data) < 20:
            raise OSError(28, "No space left on device")
        return true_write(descriptor, bytes(data)[:15])

    monkeypatch.setattr("instdrive_core.project.journal.os.write", half_a_line)
    do(document, recovery, DeleteInstances((2,)))
    with pytest.raises(DataError, match="No space left"):
        recovery.flush()
    assert "No space left" in str(recovery.take_problem())
    do(document, recovery, RenameInstance(3, "tram"))
    time.sleep(0.1)
    assert recovery.take_problem() is None, "told once"
    monkeypatch.setattr("instdrive_core.project.journal.os.write", true_write)
    die(recovery)
    (session,) = find_pending_sessions(root)
    assert snapshot(restore_session(session).document) == snapshot(document)


# What cannot be restored


def test_a_changed_scene_is_told(tmp_path, root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    die(recovery)
    scene = open_scene(tmp_path / "street")
    scene.gaussians.means[0] += 1
    save_scene(tmp_path / "street", scene)
    (session,) = find_pending_sessions(root)
    with pytest.raises(SceneChangedError):
        restore_session(session)
    restored = restore_session(session, accept_changed=True)
    assert restored.document.history.cursor == 1
    restored.remove()


def test_a_session_that_cannot_be_read_says_why_and_can_be_discarded(root, started):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    die(recovery)
    (recovery.folder / SESSION).write_text("{}")
    (session,) = find_pending_sessions(root)
    assert "cannot be read" in session.problem
    with pytest.raises(DataError, match="cannot be read"):
        restore_session(session)
    discard_session(session)
    assert find_pending_sessions(root) == []


@pytest.mark.parametrize(
    "lie", [{"saved": 1.5}, {"saved": 99}, {"saved": "1"}, {"cursor": 1.0}, {"cursor": True, "keep": 1.5, "add": []}]
)
def test_a_line_that_lies_with_a_right_checksum_does_not_keep_others_from_being_offered(root, started, lie):
    document, recovery = started
    do(document, recovery, DeleteInstances((2,)))
    die(recovery)
    text = json.dumps(lie).encode()
    with (recovery.folder / JOURNAL).open("ab") as file:
        file.write(b"%08x %b\n" % (zlib.crc32(text), text))
    (session,) = find_pending_sessions(root)
    assert "cannot be read" in session.problem


def test_folders_that_never_became_sessions_go_when_they_are_old(root):
    for name in ("young", "old", "died early"):
        (root / name).mkdir(parents=True)
        (root / name / LOCK).touch()
    (root / "died early" / JOURNAL).touch()
    os.utime(root / "old", (1, 1))
    assert find_pending_sessions(root) == []
    assert [folder.name for folder in root.iterdir()] == ["young"]


def test_documents_from_nowhere_are_refused(tmp_path, root):
    with pytest.raises(DataError, match="comes from no file"):
        Recovery.begin(Document(open_scene(saved_scene(tmp_path))), tmp_path / "street", root=root)
    assert not root.exists()


# A process that is killed

EDIT_FOR_EVER = """
import itertools, sys, time
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.project.open import open_document
from instdrive_core.project.recovery import Recovery
document, _ = open_document(sys.argv[1])
recovery = Recovery.begin(document, sys.argv[1])
for number in itertools.count():
    document.apply(RenameInstance(1, f"name {number}"))
    recovery.record()
    time.sleep(0.001)  # else there would be many thousands to restore
    if number % 100 == 50:
        recovery.flush()
        print(number, flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_after_a_kill_all_that_was_acknowledged_is_there(tmp_path, monkeypatch):
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path / "state"))
    path = saved_scene(tmp_path)
    command = [sys.executable, "-c", EDIT_FOR_EVER, path]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as editor:
        assert editor.stdout is not None
        acknowledged = int(editor.stdout.readline())
        assert find_pending_sessions() == [], "it still runs"
        editor.send_signal(signal.SIGKILL)
    (session,) = find_pending_sessions()
    assert session.folder.parent == Path(tmp_path / "state" / "recovery")
    restored = restore_session(session)
    assert restored.document.history.cursor > acknowledged
    names = [edit.name for edit in restored.document.history.edits]
    assert names == [f"name {number}" for number in range(len(names))]
    restored.remove()
