"""The report of what a deletion left, in a session without a window."""

from threading import current_thread, main_thread
from time import sleep

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, OTHER_CAR, PAVEMENT, ROAD, parked_street
from session_driver import finish

from instdrive_app.actions import register_actions
from instdrive_app.panels.overlays.hole_pattern import build_hole_pattern, project_shapes
from instdrive_app.session.editor_session import EditorSession
from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteRows
from instdrive_core.edits.kinds.fill_hole import FillHole
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import save_scene
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.selection import Flag


@pytest.fixture
def session():
    session = EditorSession()
    register_actions(session)
    session.show(Document(parked_street().scene))
    yield session
    session.close()


def texts(session):
    return [message.text for message in session.messages.log]


def test_a_deletion_is_reported_and_cleaned_up(session):
    assert not session.actions["deletion.fill"].enabled()
    session.deletion.delete((CAR,))
    assert session.deletion.review.findings is None, "nothing waits for the report"
    finish(session)
    found = session.deletion.review.findings
    assert 40 <= found.residue_count < 50
    assert texts(session)[-1] == f"Deleted Car 7: {found.report.summary}"
    assert session.actions.run("deletion.absorb")
    assert session.deletion.review.findings.residue_count == 0
    assert not session.actions.run("deletion.absorb"), "there is nothing left to absorb"
    assert session.actions.run("deletion.fill")
    assert not session.actions.run("deletion.fill"), "it is being worked out"
    finish(session)
    assert session.deletion.review.findings is None
    titles = [edit.title for edit in session.document.history.done]
    assert titles[:2] == ["Delete instance 7", "Absorb floaters of Car 7"]
    assert titles[2].startswith("Fill hole of")


def test_a_fill_that_an_edit_has_made_void_is_computed_again_beside_the_window(session, monkeypatch):
    planned = []
    plan = FillHole._plan

    def note(edit, document):
        planned.append(current_thread() is main_thread())
        return plan(edit, document)

    monkeypatch.setattr(FillHole, "_plan", note)
    session.deletion.delete((CAR,))
    finish(session)
    session.deletion.review.fill()
    done = []
    for row in session.document.find_rows((ROAD,))[:3]:
        done.append(session.history.apply(DeleteRows(np.array([row]))))
        while not session.jobs.current.future.done():
            sleep(0.01)
        session.tick(0.02)
    finish(session)
    assert done == [True, True, False], "the third try makes edits wait"
    assert session.document.history.done[-1].title.startswith("Fill hole of")
    assert planned == [False] * 3, "never by the window's own thread"
    assert texts(session)[-1].startswith("Filled a hole of")


def test_a_fill_of_a_hole_that_is_undone_meanwhile_is_given_up(session):
    session.deletion.delete((CAR,))
    finish(session)
    session.deletion.review.fill()
    session.history.undo()
    finish(session)
    assert not session.document.history.done
    assert not session.deletion.review.is_filling


def test_undo_brings_the_report_back_and_takes_it_away(session):
    session.deletion.delete((CAR,))
    finish(session)
    session.deletion.review.absorb()
    session.deletion.review.fill()
    finish(session)
    session.history.undo()
    found = session.deletion.review.findings
    assert (found.residue_count, bool(found.holes)) == (0, True)
    session.history.undo()
    count = session.deletion.review.findings.residue_count
    assert 40 <= count < 50
    session.history.undo()
    assert session.deletion.review.findings is None
    session.history.redo()
    assert session.deletion.review.findings.residue_count == count
    session.actions.run("deletion.clear")
    assert session.deletion.review.findings is None


def test_selected_splats_leave_what_was_missed(session):
    document = session.document
    rows = document.find_rows((CAR,))
    session.history.apply(SelectRows(rows[50:]))
    session.deletion.delete_selection()
    finish(session)
    found = session.deletion.review.findings
    assert found.report.carriers[CAR] > 25
    session.deletion.review.absorb()
    assert np.isin(document.state.find_rows(Flag.DELETED), found.report.residue).sum() == len(found.report.residue)


def test_it_is_told_that_nothing_fills_what_a_surface_hid(session):
    session.deletion.delete((ROAD,))
    finish(session)
    assert texts(session)[-1].endswith("no photo shows what is below it")
    assert session.deletion.review.findings is None


def test_a_report_of_a_deletion_that_was_undone_or_of_another_scene_is_not_shown(session):
    session.deletion.delete((CAR,))
    session.history.undo()
    finish(session)
    assert session.deletion.review.findings is None
    session.deletion.delete((CAR,))
    session.show(Document(parked_street().scene))
    finish(session)
    assert session.deletion.review.findings is None
    session.deletion.delete((CAR,))
    finish(session)
    session.show(Document(parked_street().scene))
    assert session.deletion.review.findings is None


def test_editing_goes_on_while_a_fill_is_worked_out(session):
    session.deletion.delete((CAR,))
    finish(session)
    session.deletion.review.fill()
    session.deletion.delete((OTHER_CAR,))
    finish(session)
    kinds = [edit.kind for edit in session.document.history.done]
    assert kinds == ["delete_instances", "delete_instances", "fill_hole"]


def test_a_hole_without_ground_around_is_explained(session):
    session.deletion.delete((CAR,))
    finish(session)
    report = session.deletion.review.findings
    session.deletion.delete((1, 2, 3))
    finish(session)
    assert session.deletion.review.findings is report
    session.deletion.review.fill()
    finish(session)
    assert texts(session)[-1].startswith("The hole cannot be filled: no ground")
    assert not session.deletion.review.is_filling


def test_the_pattern_covers_the_hole():
    hole = report_deletion(Document(parked_street().scene), (CAR,), 0.0).holes[0]
    pattern = build_hole_pattern(hole)
    first, second = (pattern.stripes[:, k] - pattern.stripes[:, 0] for k in (1, 3))
    areas = np.linalg.norm(np.cross(first, second), axis=1)
    assert areas.sum() == pytest.approx(hole.area, rel=0.01)
    lengths = np.linalg.norm(pattern.outline[:, 1] - pattern.outline[:, 0], axis=1)
    np.testing.assert_allclose(lengths, hole.grid.size, rtol=0.01)
    heights = hole.grid.compute_heights(pattern.outline.reshape(-1, 3))
    np.testing.assert_allclose(heights, 0, atol=1e-9)
    ends = {tuple(point) for point in pattern.outline.reshape(-1, 3).round(6).tolist()}
    counts = [np.all(np.isclose(pattern.outline.reshape(-1, 3), end), axis=1).sum() for end in ends]
    assert all(count % 2 == 0 for count in counts), "the outline is closed"
    ahead = Camera(100.0, 100.0, 50.0, 50.0, 100, 100, look_at(np.array([0.0, -9, 2]), np.array([2.0, 0, 0])))
    behind = Camera(100.0, 100.0, 50.0, 50.0, 100, 100, look_at(np.array([0.0, -9, 2]), np.array([0.0, -20, 0])))
    assert len(project_shapes(pattern.stripes, ahead)) == len(pattern.stripes)
    assert project_shapes(pattern.stripes, behind) == []


def test_nothing_is_told_where_very_many_instances_were_deleted(session, monkeypatch):
    monkeypatch.setattr("instdrive_app.session.deletion_review.MOST_INSTANCES", 1)
    session.deletion.delete((CAR,))
    finish(session)
    found = session.deletion.review.findings
    assert found is not None
    session.deletion.delete((OTHER_CAR, ROAD))
    assert session.jobs.current is None
    assert session.deletion.review.pending == (found,), "what was found before waits"


@pytest.fixture
def two_holes(session):
    """The session on a street whose other car hides bare ground, too."""
    document = Document(parked_street().scene)
    away = np.abs(document.scene.gaussians.means[:, :2] - CAR_CENTER[:2] - [0, 6.5])
    is_ground = np.isin(document.scene.instance_ids, (ROAD, 2))
    document.apply(DeleteRows(np.flatnonzero(is_ground & (away < CAR_SIZE[:2] / 2).all(axis=1))))
    session.show(Document(bake_document(document)))
    return session


def test_holes_wait_while_other_things_are_deleted_and_one_is_dismissed(two_holes):
    session = two_holes
    for number in (CAR, OTHER_CAR):
        session.deletion.delete((number,))
        finish(session)
    review = session.deletion.review
    assert [found.report.name for found in review.pending] == ["Car 7", "Car 8"]
    kept = [found.report.clearings[0].record is not None for found in review.pending]
    assert kept == [False, True], "only the last report keeps what the photos showed"
    session.actions.run("deletion.clear")
    assert len(review.pending) == 1, "only the report that is shown is dismissed"
    session.history.undo()
    assert review.findings.report.parts[0].instance_id == CAR


def test_all_holes_are_filled_one_after_the_other(two_holes):
    session = two_holes
    for number in (CAR, OTHER_CAR):
        session.deletion.delete((number,))
        finish(session)
    holes = sum(bool(found.holes) for found in session.deletion.review.pending)
    assert session.actions.run("deletion.fill_all")
    for _ in range(4):
        finish(session)
    kinds = [edit.kind for edit in session.document.history.done]
    assert kinds.count("fill_hole") == holes == 2
    assert all(not found.holes for found in session.deletion.review.pending)


def test_the_place_that_a_moved_car_leaves_is_offered_once(session):
    session.history.apply(MoveInstances((CAR,), rotation=(0.9, 0.0, 0.0, 0.4)))
    for _ in range(2):
        session.tick(1.0)
        finish(session)
    assert session.deletion.review.findings is None, "a car that turns still stands there"
    session.history.undo()
    session.history.apply(MoveInstances((CAR,), (0.0, 20.0, 0.0)))
    session.tick(0.1)
    finish(session)
    assert session.deletion.review.findings is None, "it may be moved on"
    session.tick(1.0)
    finish(session)
    found = session.deletion.review.findings
    assert found.title == "Moved Car 7"
    deleted = report_deletion(Document(parked_street().scene), (CAR,), 0.0)
    assert found.report.hole_area == pytest.approx(deleted.hole_area, rel=0.3)
    session.history.apply(MoveInstances((CAR,), (0.0, 5.0, 0.0)))
    for _ in range(3):
        session.tick(1.0)
        finish(session)
    assert len(session.deletion.review.pending) == 1
    session.deletion.review.fill()
    finish(session)
    assert session.deletion.review.findings is None
    assert session.document.history.done[-1].title == f"Fill hole of {found.report.fill_area:.1f} m²"


def test_a_shadow_laid_before_the_place_is_looked_at_hides_no_hole(session):
    session.tick(0.0)
    session.history.apply(MoveInstances((CAR,), (-4.0, 0.0, 0.0)))
    for _ in range(3):
        session.tick(0.21)
        finish(session)
    assert isinstance(session.document.history.done[-1], CompoundEdit), "the move has its shadow"
    assert session.deletion.review.findings is None
    session.tick(1.0)
    finish(session)
    assert session.deletion.review.findings.title == "Moved Car 7"


def test_holes_are_offered_again_after_saving_and_reopening(two_holes, tmp_path):
    session = two_holes
    save_scene(tmp_path / "street", session.document.scene)
    session.files.open(tmp_path / "street")
    finish(session)
    for number in (CAR, OTHER_CAR):
        session.deletion.delete((number,))
        finish(session)
    session.deletion.review.fill()
    finish(session)
    assert [found.deletion.ids for found in session.deletion.review.pending if found.holes] == [(CAR,)]
    session.files.save(tmp_path / "work.instdrive")
    finish(session)
    session.files.open(tmp_path / "work.instdrive")
    finish(session)
    pending = [found for found in session.deletion.review.pending if found.holes]
    assert [found.deletion.ids for found in pending] == [(CAR,)]
    session.deletion.review.fill()
    finish(session)
    assert not [found for found in session.deletion.review.pending if found.holes]


def test_things_deleted_together_leave_one_report_and_are_filled_as_one_step(session):
    scene = parked_street().scene
    scene.gaussians.means[scene.instance_ids == OTHER_CAR] += np.float32([0, 3.0, 0.06])  # too far for one hole
    session.show(Document(scene))
    session.deletion.delete((CAR, OTHER_CAR))
    finish(session)
    (found,) = session.deletion.review.pending
    assert found.title == "Deleted 2 instances"
    assert len(found.holes) == 2
    assert session.actions.run("deletion.fill")
    finish(session)
    assert texts(session)[-1] == f"Filled 2 holes of {found.report.fill_area:.1f} m² with synthetic ground"
    assert session.document.history.done[-1].title == f"Fill 2 holes of {found.report.fill_area:.1f} m²"
    assert not found.holes
    session.history.undo()
    assert len(session.deletion.review.findings.holes) == 2, "undo brings both back"


def test_it_is_told_where_no_ground_is_left_to_fill_from(session):
    session.deletion.delete((ROAD, PAVEMENT))
    finish(session)
    session.deletion.delete((CAR,))
    finish(session)
    assert texts(session)[-1].endswith("no ground found around it to fill from")
