"""No command does nothing without a word: it changes something, asks, or says why not."""

import time

import numpy as np
import pytest
from procedural_street import procedural_street

from instdrive_app.actions import register_actions
from instdrive_app.actions.conditions import QUIET, explain_disabled, run_or_explain
from instdrive_app.camera import pan
from instdrive_app.language.translation import speak, translate
from instdrive_app.panels.window_menu import list_panel_actions
from instdrive_app.session.editor_session import EditorSession
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.scene import scene_from_gaussians

MAY_STAY = {
    "view.color": "the view shows colours already",
    "tool.pick": "the tool is in the hand already",
    "tool.whole_instances": "a switch that is on",
    "tool.single_splats": "a switch that is on",
    "view.next_kept": "the only kept view is shown",
    "view.previous_kept": "the only kept view is shown",
}
"""What is chosen already, and shown as such."""


def open_nothing(session):
    pass


def open_foreign(session):
    session.show(Document(scene_from_gaussians(procedural_street().gaussians.select(slice(0, None, 4)))))


def open_street(session):
    session.show(Document(procedural_street()))


def describe(session):
    """Everything that the user can see change."""
    document, state = session.document, session.state
    pose = state.viewpoint.world_from_camera.round(9).tobytes()
    shown = ({**vars(state), "viewpoint": pose, "hovered": 0}, session.movement.options, session.navigation.playing)
    aids = (session.aids.box.box, session.aids.ruler.points, session.aids.bookmarks.kept)
    edits = None if document is None else (document.history.cursor, len(document.history.edits), document.versions)
    job = session.jobs.current.title if session.jobs.current is not None else ""
    colors = session.colors.find_mode(()), session.colors._frames_to_picker
    return repr((shown, aids, edits, session.is_quitting, job, colors))


def return_to(session, start):
    """Undo everything and show what was shown at first."""
    if session.document is not None:
        session.history.jump(0)
        while session.history.is_jumping:
            session.tick(0.0)
        del session.document.history._edits[:]
        session.deletion.review.clear_all()
    vars(session.state).update(start)


def settle(session):
    end = time.monotonic() + 60
    while session.jobs.current is not None and time.monotonic() < end:
        session.tick(0.01)
        time.sleep(0.002)


@pytest.mark.parametrize("with_selection", [False, True], ids=["nothing selected", "all selected"])
@pytest.mark.parametrize("prepare", [open_nothing, open_foreign, open_street])
def test_every_command_changes_asks_or_explains(prepare, with_selection, tmp_path, monkeypatch):
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    session = EditorSession()
    register_actions(session, list_panel_actions)
    session.state.picture_size = (32, 18)
    prepare(session)
    settle(session)
    session.state.viewpoint = pan(session.state.viewpoint, 1.5, 0.5)
    start, silent = dict(vars(session.state)), []
    try:
        for action in [action for action in session.actions if action.id not in ("file.sample", "file.quit")]:
            return_to(session, start)
            if with_selection and session.document is not None:
                session.actions.run("select.all")
            before, told, asked = describe(session), len(session.messages.log), len(session.requests.waiting)
            session.messages.dismiss()
            run_or_explain(session, action)
            changed = describe(session) != before
            settle(session)
            changed |= describe(session) != before or len(session.requests.waiting) > asked
            if not changed and len(session.messages.log) == told and action.id not in MAY_STAY:
                silent.append(action.id)
        allowed = {action.id for action in session.actions if QUIET.intersection(action.shortcuts)}
        assert set(silent) <= allowed, sorted(set(silent) - allowed)
    finally:
        session.close()


def test_a_reason_is_told_once_while_it_is_seen(session):
    for _ in range(3):
        run_or_explain(session, session.actions["edit.delete"])
    told = [message.text for message in session.messages.log if message.text.startswith("Delete: ")]
    assert told == [f"Delete: {explain_disabled(session, session.actions['edit.delete'])}"]
    assert np.all([not session.actions[name].enabled() for name in ("box.select", "measure.clear")])


def test_a_reason_is_told_in_the_language_of_the_window(session):
    action = session.actions["labels.reassign"]
    run_or_explain(session, action)
    speak("de")
    try:
        told = translate(session.messages.log[-1].text)
    finally:
        speak("en")
    assert action.needs in session.messages.log[-1].text
    assert action.needs not in told
