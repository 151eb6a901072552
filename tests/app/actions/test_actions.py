"""What holds for every action of the editor."""

import pytest
from imgui_bundle import imgui

from instdrive_app.action import Action, ActionRegistry
from instdrive_app.actions import register_actions
from instdrive_app.actions.conditions import explain_disabled
from instdrive_app.panels.dialogs.command_palette import _list_matches
from instdrive_app.panels.widgets.shortcuts import parse_shortcut
from instdrive_app.panels.widgets.ui import get_icon
from instdrive_app.panels.window_menu import list_panel_actions
from instdrive_app.session.editor_session import EditorSession


def list_all(session):
    register_actions(session, list_panel_actions)
    return tuple(session.actions)


def describe(session):
    """Everything that an action can change, ask for or say without a scene."""
    switches = session.state, session.movement.options, session.navigation.playing, session.is_quitting
    job = session.jobs.current and session.jobs.current.title  # its share moves on beside any action
    return repr((switches, session.requests.waiting, session.messages.log, job))


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """An editor without a scene, which has never opened one."""
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path))
    made = EditorSession()
    yield made
    made.close()


def test_every_action_has_a_title_a_menu_an_icon_and_keys_of_its_own(empty):
    actions = list_all(empty)
    for action in actions:
        assert action.title, action.id
        assert action.title == action.title.strip(), action.id
        assert action.menu, action.id
        assert get_icon(action.icon), action.id
        for shortcut in action.shortcuts:
            assert parse_shortcut(shortcut) > 0, action.id
    titles = [(action.menu, action.title) for action in actions]
    chords = [parse_shortcut(shortcut) for action in actions for shortcut in action.shortcuts]
    assert len(set(titles)) == len(titles)
    assert len(set(chords)) == len(chords)
    assert parse_shortcut("Ctrl+Shift+Z") == int(imgui.Key.mod_ctrl) | int(imgui.Key.mod_shift) | int(imgui.Key.z)
    assert parse_shortcut("1") == imgui.Key._1


def test_without_a_scene_every_action_is_disabled_or_does_something(empty):
    for action in list_all(empty):
        is_on, before = action.checked is not None and action.checked(), describe(empty)
        if action.items is not None:
            assert action.items() == []
        if empty.actions.run(action.id):
            assert is_on or describe(empty) != before, action.id
        else:
            assert describe(empty) == before, action.id


def test_with_a_scene_every_action_runs(session):
    """None of them fails, whatever is selected."""
    for selected in ((), tuple(instance.id for instance in session.document.scene.table)):
        session.selection.select(selected)
        for action in session.actions:
            if action.id not in ("file.sample", "file.quit"):
                session.actions.run(action.id)
                session.tick(0.01)


@pytest.mark.parametrize("word", ["screenshot", "picture", "camera", "crop", "video"])
def test_the_palette_knows_the_words_of_other_programs(session, word):
    assert _list_matches(word, session.actions)


def test_what_cannot_run_says_why(session, empty):
    assert explain_disabled(session, session.actions["deletion.fill"]) == "There is no hole to fill"
    assert explain_disabled(session, session.actions["edit.delete"]) == "Select something first"
    register_actions(empty)
    assert explain_disabled(empty, empty.actions["edit.delete"]) == "Open a scene first"


def test_an_action_is_registered_once_and_takes_no_others_keys():
    registry = ActionRegistry()
    registry.add(Action("a", "A", lambda: None, "File", ("Ctrl+A",)))
    with pytest.raises(ValueError, match="registered twice"):
        registry.add(Action("a", "Again", lambda: None))
    with pytest.raises(ValueError, match=r"Ctrl\+A is the shortcut of 'a' and of 'b'"):
        registry.add(Action("b", "B", lambda: None, "File", ("Ctrl+A",)))
