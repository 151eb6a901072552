"""The editor's controller without a window."""

import threading
import time

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, SHARED_CODEWORD, procedural_street
from session_driver import errors, finish

from instdrive_app.action import Action, ActionRegistry
from instdrive_app.actions import register_actions
from instdrive_app.messages import Messages
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import ViewMode, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.progress import report, report_span


def test_opening_looks_through_the_first_dataset_camera(session, street):
    assert session.state.dataset_view == 0
    np.testing.assert_array_equal(
        session.state.viewpoint.world_from_camera, street.scene.views[0].camera.world_from_camera
    )
    assert session.navigation.timeline.steps == (0.0, 0.5, 1.0, 1.5)


def test_regions_select_splats_where_there_are_no_instances(session):
    plain = procedural_street()
    plain.instance_ids[:] = 0
    plain.table.instances.clear()
    session.show(Document(plain))
    assert session.state.region_splats
    assert session.messages.log[-1].text.endswith(" splats")
    session.show(Document(procedural_street()))
    assert not session.state.region_splats
    assert session.messages.log[-1].text.endswith(" instances")


def test_delete_undo_redo_and_jump(session, street):
    session.selection.select((FIRST_CAR,))
    assert session.actions.run("edit.delete")
    assert FIRST_CAR not in street.find_visible_instances()
    session.actions.run("edit.undo")
    assert FIRST_CAR in street.find_visible_instances()
    session.actions.run("edit.redo")
    assert FIRST_CAR not in street.find_visible_instances()
    assert not session.actions.run("edit.redo")
    session.history.jump(0)
    assert street.history.cursor == 0
    session.history.jump(2)
    assert FIRST_CAR not in street.find_visible_instances()


def test_selection_modes_and_codeword(session):
    session.selection.select((FIRST_CAR,))
    session.selection.select((FIRST_CAR + 2,), "add")
    session.selection.select((FIRST_CAR,), "remove")
    assert session.selection.ids == (FIRST_CAR + 2,)
    session.selection.select_codeword(FIRST_CAR)
    assert session.selection.ids == (FIRST_CAR, FIRST_CAR + 1)
    assert session.document.scene.table[FIRST_CAR].codeword == SHARED_CODEWORD
    session.selection.clear()
    steps = session.document.history.cursor
    session.selection.clear()
    assert session.document.history.cursor == steps, "clearing nothing is no step"


def test_hide_solo_and_show_all(session, street):
    everything = street.find_visible_instances()
    session.visibility.hide((FIRST_CAR,))
    assert FIRST_CAR not in street.find_visible_instances()
    session.visibility.show_all()
    session.visibility.solo.toggle((FIRST_CAR,))
    assert street.find_visible_instances() == (FIRST_CAR,)
    session.visibility.solo.toggle((FIRST_CAR,))
    assert street.find_visible_instances() == everything


def test_a_drag_of_the_color_picker_is_one_step(session, street):
    before = street.history.cursor
    for red in (0.1, 0.5, 0.9):
        session.colors.recolor((FIRST_CAR,), "solid", (red, 0.0, 0.0), "drag 1")
    assert street.history.cursor == before + 1
    session.colors.recolor((FIRST_CAR,), "solid", (0.0, 1.0, 0.0), "drag 2")
    assert street.history.cursor == before + 2


def test_what_cannot_be_done_is_told_and_changes_nothing(session, street):
    session.deletion.delete((999,))
    assert "999" in errors(session)[-1]
    session.labels.rename(FIRST_CAR, "two\nlines")
    assert "printable" in errors(session)[-1]
    assert street.history.cursor == 0


def test_the_dataset_camera_follows_the_time_and_orbiting_leaves_it(session, street):
    session.navigation.choose_camera("right_camera")
    session.navigation.step(1)
    view = street.scene.views[session.state.dataset_view]
    assert (view.name, view.time) == ("right_camera", 0.5)
    session.navigation.step(-2)
    assert session.state.time == 1.5, "around the ends"
    session.navigation.look_from(session.state.viewpoint)
    session.navigation.set_time(0.7)
    assert (session.state.dataset_view, session.state.time) == (None, 0.7)


def test_playing_steps_at_the_pace_of_the_drive(session):
    session.actions.run("time.play")
    session.tick(0.3)
    assert session.state.time == 0.0
    session.tick(0.3)
    assert session.state.time == 0.5
    session.actions.run("time.play")
    session.tick(5.0)
    assert session.state.time == 0.5


def test_framing_a_moving_car_looks_at_where_it_is_now(session, street):
    session.navigation.set_time(1.0)
    session.navigation.frame((DRIVING_CAR,))
    place = street.scene.actors[0].interpolate_pose(1.0)[:3, 3]
    assert np.linalg.norm(session.state.viewpoint.pivot - place) < 0.5


def test_export_bakes_the_shown_moment_into_a_file_and_keeps_tracks_in_a_folder(session, street, tmp_path):
    session.navigation.look_from(session.state.viewpoint)
    session.navigation.set_time(1.0)
    session.deletion.delete((FIRST_CAR,))
    for name in ("edited.compressed.ply", "edited.splat", "edited.ply", "edited_run"):
        session.export.write(tmp_path / name)
        finish(session)
        assert session.files.last_export == tmp_path / name
    file, folder = open_scene(tmp_path / "edited.ply"), open_scene(tmp_path / "edited_run")
    gone = street.scene.table[FIRST_CAR].count
    assert len(file) == len(folder) == len(street.scene) - gone
    assert (len(file.actors), len(folder.actors)) == (0, 1)
    for name in ("edited.compressed.ply", "edited.splat"):
        assert len(open_scene(tmp_path / name)) == len(file)
    center = file.gaussians.means[file.instance_ids == DRIVING_CAR].mean(axis=0)
    assert np.linalg.norm(center - street.scene.actors[0].interpolate_pose(1.0)[:3, 3]) < 0.5


def test_opening_and_exporting_run_beside_the_window_and_failures_become_messages(session, tmp_path):
    save_scene(tmp_path / "other.ply", freeze_at_time(procedural_street(0.4), 0.0))
    session.files.open(tmp_path / "other.ply")
    assert session.jobs.is_blocking
    session.deletion.delete((FIRST_CAR,))
    assert "wait" in errors(session)[-1]
    finish(session)
    assert session.files.path == tmp_path / "other.ply"
    (tmp_path / "broken.ply").write_bytes(b"ply\nnonsense")
    session.files.open(tmp_path / "broken.ply")
    finish(session)
    assert "broken.ply" in errors(session)[-1]
    assert session.files.path == tmp_path / "other.ply"


def test_a_defect_in_a_job_is_told_and_its_traceback_logged(session, caplog):
    def fail():
        raise ZeroDivisionError("a defect")

    session.jobs.submit("Working", fail)
    finish(session)
    assert "ZeroDivisionError" in errors(session)[-1]
    assert "test_session.py" in caplog.text


def test_a_job_tells_how_far_it_is_and_can_be_cancelled(session):
    reached = threading.Event()

    def work():
        with report_span(0.0, 0.5):
            report(1.0)
        reached.set()
        while True:
            report(0.75)
            time.sleep(0.001)

    session.jobs.submit("Working", work)
    assert reached.wait(120)
    while session.jobs.current.share != 0.75:  # the tests' time limit ends it
        time.sleep(0.001)
    session.jobs.cancel()
    finish(session)
    assert session.messages.log[-1].text == "Working was cancelled"
    assert not errors(session)


def test_of_jobs_aside_only_the_newest_counts_and_nothing_waits_for_them(session):
    begun, let_go, results = threading.Event(), threading.Event(), []

    def slow():
        begun.set()
        let_go.wait(120)
        report(0.5)
        return "old"

    session.jobs.submit_in_background("Looking", slow, results.append)
    assert begun.wait(120)
    session.jobs.submit_in_background("Looking", lambda: "new", results.append)
    session.jobs.submit("Saving", lambda: "saved", results.append)
    assert session.jobs.is_blocking
    while not results:
        session.tick(0.0)
    assert results == ["saved"], "what stands aside holds nothing up"
    let_go.set()
    finish(session)
    assert results == ["saved", "new"]
    assert not session.messages.log or "cancelled" not in session.messages.log[-1].text


def test_view_modes_and_switches(session):
    for mode in ViewMode:
        command = session.actions[f"view.{mode.name.lower()}"]
        command.run()
        assert session.state.view_mode is mode
        assert command.checked()
    session.actions.run("view.sky")
    assert not session.state.show_sky


def test_a_scene_without_cameras_tracks_or_instances_can_be_shown(tmp_path):
    scene = procedural_street(0.5)
    scene.views, scene.actors, scene.sky = (), (), None
    scene.nodes[:] = 0
    session = EditorSession()
    register_actions(session)
    session.show(Document(scene))
    assert session.state.dataset_view is None
    assert not session.actions.run("time.next")
    assert not session.actions.run("edit.delete")
    session.close()


def test_commands_refuse_ids_and_shortcuts_that_are_taken():
    commands = ActionRegistry()
    commands.add(Action("a", "A", print, shortcuts=("Ctrl+A",)))
    with pytest.raises(ValueError, match="twice"):
        commands.add(Action("a", "A again", print))
    with pytest.raises(ValueError, match=r"Ctrl\+A"):
        commands.add(Action("b", "B", print, shortcuts=("Ctrl+A",)))


def test_toasts_fade_and_the_log_stays():
    now = [0.0]
    messages = Messages(lambda: now[0])
    messages.info("done")
    messages.error("failed")
    assert len(messages.toasts) == 2
    now[0] = 5.0
    assert [toast.text for toast in messages.toasts] == ["failed"]
    messages.dismiss()
    assert messages.toasts == ()
    assert len(messages.log) == 2


def test_what_is_shown_alone_stands_before_a_plain_backdrop(session):
    def draws_sky():
        session.tick(0.0)
        return resolve(session.state, 64, 48).show_sky

    assert draws_sky()
    session.visibility.solo.enter((FIRST_CAR,))
    assert not draws_sky()
    session.history.undo()
    assert draws_sky()
    session.history.redo()
    assert not draws_sky()
    session.actions.run("view.plain_solo")
    assert draws_sky()
