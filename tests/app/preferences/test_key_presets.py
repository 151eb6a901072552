"""Key presets and own keys: no key means two things, and files bring keys back or say what is wrong."""

import json
from collections import Counter

import pytest

from instdrive_app.actions import register_actions
from instdrive_app.panels.widgets.shortcuts import parse_shortcut
from instdrive_app.panels.window_menu import list_panel_actions
from instdrive_app.preferences.key_presets import LEFT, MIDDLE, PRESETS, RIGHT, merge_keys, read_keys, write_keys
from instdrive_app.preferences.preferences import Preferences, PreferenceStore, read_preferences
from instdrive_app.session.editor_session import EditorSession
from instdrive_core.errors import DataError


@pytest.fixture
def editor(tmp_path, monkeypatch):
    """An editor without a window or a scene, which has all actions."""
    monkeypatch.setenv("INSTDRIVE_STATE", str(tmp_path))
    made = EditorSession()
    register_actions(made, list_panel_actions)
    yield made
    made.close()


@pytest.mark.parametrize("name", PRESETS)
def test_each_key_of_a_preset_means_one_thing_and_exists(name, editor):
    editor.preferences.change(preset=name)
    editor.tick(0.0)
    assert set(PRESETS[name].keys) <= {action.id for action in editor.actions}
    counts = Counter(key for action in editor.actions for key in action.shortcuts)
    assert {key: count for key, count in counts.items() if count > 1} == {}
    for key in counts:
        parse_shortcut(key)
    if PRESETS[name].flies_always:
        assert not counts.keys() & {"W", "A", "S", "D", "Q", "E"}


def test_own_keys_come_before_those_of_the_preset(editor):
    editor.preferences.change(preset="blender", keys={"edit.hide": ("G",), "gone.command": ("F9",)})
    editor.tick(0.0)
    assert editor.actions["edit.hide"].shortcuts == ("G",)
    assert editor.actions["tool.move"].shortcuts == ()
    assert editor.actions["edit.delete"].shortcuts == ("X", "Delete")
    editor.preferences.change(preset="instdrive", keys={})
    editor.tick(0.0)
    assert {action.id: action.shortcuts for action in editor.actions} == editor.actions.usual_keys


def test_gestures_are_those_of_the_program():
    plain = (False, False, False)
    shift, ctrl, alt = (True, False, False), (False, True, False), (False, False, True)
    blender, unreal, ours = PRESETS["blender"], PRESETS["unreal"], PRESETS["instdrive"]
    assert [blender.find_motion(MIDDLE, *held) for held in (plain, shift, ctrl)] == ["orbit", "pan", "dolly"]
    assert [unreal.find_motion(RIGHT, *held) for held in (plain, alt)] == ["look", "dolly"]
    assert [PRESETS["supersplat"].find_motion(button, *plain) for button in range(3)] == ["orbit", "pan", "dolly"]
    assert [ours.find_motion(LEFT, *held) for held in (plain, shift, alt)] == ["orbit", "pan", "orbit"]


def test_keys_come_back_from_a_file(tmp_path):
    usual = {"one": ("A",), "two": ("B",)}
    write_keys(tmp_path / "keys.json", "unreal", {"one": ("Ctrl+B", "F2"), "two": ()})
    assert read_keys(tmp_path / "keys.json", usual) == ("unreal", {"one": ("Ctrl+B", "F2"), "two": ()})


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("{", "cannot be read"),
        ("[]", "'preset' and 'keys' are missing"),
        ({"preset": "emacs", "keys": {}}, "'preset' and 'keys' are missing"),
        ({"preset": "unreal", "keys": {"three": ["A"]}}, "no command 'three'"),
        ({"preset": "unreal", "keys": {"one": "A"}}, "must be a list"),
        ({"preset": "unreal", "keys": {"one": ["A"], "two": ["A"]}}, "A is the key of 'one' and of 'two'"),
        ({"preset": "unreal", "keys": {"one": ["Hyper+A"]}}, "no key 'Hyper\\+A'"),
    ],
)
def test_a_faulty_file_of_keys_says_what_is_wrong(content, told, tmp_path):
    path = tmp_path / "keys.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(DataError, match=told) as caught:
        read_keys(path, {"one": ("A",), "two": ("B",)})
    assert str(path) in str(caught.value)


def test_stored_choices_that_do_not_fit_are_told_and_left(tmp_path):
    told = []
    stored = {"theme": "pink", "safe_colors": True, "preset": 3, "keys": {"one": "A"}}
    assert read_preferences(stored, told.append) == Preferences(safe_colors=True)
    assert len(told) == 3
    store = PreferenceStore(tmp_path / "preferences.json")
    store.change(theme="light", keys={"one": ("A",)})
    assert PreferenceStore(store.file).current == Preferences(theme="light", keys={"one": ("A",)})


def test_a_key_given_away_is_no_one_elses():
    usual = {"one": ("A",), "two": ("B",)}
    assert merge_keys(usual, PRESETS["instdrive"], {"two": ("A",)}) == {"one": (), "two": ("A",)}
