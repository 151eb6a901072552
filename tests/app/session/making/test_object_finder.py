"""The editor and the job that finds objects in photos: what it is begun with, and what becomes of what it found."""

import numpy as np
import pytest
from session_driver import errors, finish

from instdrive_app.session.making.object_finder import FindChoice
from instdrive_core.finding.seen_objects import SeenObjects, identify_rows, write_seen_objects
from instdrive_core.jobs.job_file import EDITS, JobRequest, JobState, locate_job_file, locate_project, write_job_state
from instdrive_core.project.open import open_project


@pytest.fixture
def opened(session, street_folder):
    """The session with the street opened from its folder."""
    session.making.known.clear()
    session.files.open(street_folder)
    finish(session)
    yield session
    session.making.known.clear()


def write_result(session, run, replaces=False, scene=None):
    """A job that is done: it tells the first hundred splats from the others."""
    document = session.document
    numbers = np.full(len(document.scene), 1, np.uint32)
    numbers[:100] = 2
    digest = identify_rows(document.open_scene.base) if scene is None else scene
    write_job_state(run, JobState(JobRequest("street", kind="find-objects", replaces=replaces), "done"))
    write_seen_objects(run, SeenObjects(numbers, ("", "Van"), 5, digest))
    session.making.known.add(run)
    return run


def test_a_job_begins_with_the_edits_as_they_are(opened, street_folder, tmp_path, monkeypatch):
    begun = []
    monkeypatch.setattr(opened.making, "_start", lambda run, *arguments: begun.append((run, arguments)))
    opened.labels.rename(1, "road of all roads")
    assert opened.finder.obstacle == ""
    opened.finder.begin(FindChoice(tmp_path, "lidar", True))
    finish(opened)
    ((run, arguments),) = begun
    folder, photos = str(street_folder), str(tmp_path)
    assert arguments == (
        *("find-objects", folder, "--out", str(run), "--photos", photos, "--masks", "lidar", "--replace"),
    )
    assert open_project(locate_job_file(run, EDITS)).document.scene.table[1].name == "road of all roads"
    opened.finder.begin(FindChoice(tmp_path, "", False))
    finish(opened)
    assert begun[1][1][-2:] == ("--photos", photos)
    assert begun[1][0] != run


def test_what_was_found_becomes_one_step_of_the_history(opened, tmp_path):
    run = write_result(opened, tmp_path / "job", replaces=True)
    opened.making.follow(run)
    opened.making.open_scene()
    finish(opened)
    document = opened.document
    assert [edit.title for edit in document.history.edits] == ["Find objects"]
    assert sorted(entry.count for entry in document.scene.table) == [100, len(document.scene) - 100]
    assert "2 objects found in the masks of 5 photos" in opened.messages.log[-1].text
    assert run not in opened.making.known.paths
    opened.undo()
    assert len(document.scene.table) > 2


def test_where_nothing_is_left_to_find_the_remedy_is_told(opened, tmp_path):
    opened.finder.take(write_result(opened, tmp_path / "job"))
    finish(opened)
    assert "replace the instances" in errors(opened)[-1]
    assert not opened.document.history.edits


def test_with_another_scene_open_the_project_of_the_job_is_opened(opened, tmp_path, monkeypatch):
    left_for = []
    monkeypatch.setattr(opened.files, "leave_for", left_for.append)
    run = write_result(opened, tmp_path / "job", scene="another")
    locate_project(run).touch()
    opened.finder.take(run)
    finish(opened)
    assert left_for == [locate_project(run)]
    assert not opened.document.history.edits


def test_a_scene_from_no_file_has_no_photos(session):
    assert "comes from no file" in session.finder.obstacle
    assert session.finder.known_photos is None
