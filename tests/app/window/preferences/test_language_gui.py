"""The language of the window, chosen in Preferences of the real window with true mouse and keys."""

import json

import pytest
from window_driver import editor_window

pytestmark = pytest.mark.gui


def choose_language(window, choice):
    """Choose it in Preferences, and close them; returns where the widgets are then."""
    window.key("ctrl+comma")
    window.click_widget(f"preferences.language.{choice}")
    window.wait_for(lambda state: state["preferences"]["language"] == choice, f"the language {choice}")
    window.wait_for_widget("dialog.cancel")
    window.key("Escape")
    window.wait_for(lambda state: "dialog.cancel" not in state["widgets"], "the dialog to close")
    window.wait_until_calm()
    return window.state["widgets"]


def measure_menus(widgets):
    """Width of each title in the menu bar."""
    return {name: round(place[2] - place[0]) for name, place in widgets.items() if name.startswith("menu ")}


def test_german_is_spoken_at_once_and_kept(street_folder, tmp_path):
    with editor_window(street_folder, tmp_path) as window:
        english = window.state["widgets"]
        german = choose_language(window, "de")
        assert window.state["language"] == "de"
        before, after = measure_menus(english), measure_menus(german)
        assert before.keys() == after.keys()
        assert after["menu Edit"] > before["menu Edit"] + 20  # Bearbeiten
        assert after["menu View"] > before["menu View"] + 10  # Ansicht
        window.click_widget("menu Edit")
        window.click_widget("menu edit.preferences")
        window.wait_for_widget("preferences.language.en")
        window.key("Escape")
        window.wait_for(lambda state: "dialog.cancel" not in state["widgets"], "the dialog to close")
        assert window.quit() == 0
    assert json.loads((tmp_path / "state/preferences.json").read_text())["language"] == "de"


def test_the_palette_finds_commands_by_german_and_english_words(street_folder, tmp_path):
    (tmp_path / "state").mkdir()
    (tmp_path / "state/preferences.json").write_text(json.dumps({"language": "de", "knows_first_steps": True}))
    with editor_window(street_folder, tmp_path) as window:
        assert window.state["language"] == "de"
        for typed, found in (("alles ausw", True), ("select all", True), ("kein befehl", False)):
            window.key("ctrl+p")
            window.wait_for_widget("palette.search")
            window.type(typed)
            window.wait_for(lambda state, f=found: ("palette.select.all" in state["widgets"]) == f, typed)
            window.wait_for_frames(3)
            assert ("palette.select.all" in window.state["widgets"]) == found, typed
            window.key("Escape")
            window.wait_for(lambda state: "palette.search" not in state["widgets"], "the palette to close")
        choose_language(window, "en")
        assert window.state["language"] == "en"
        assert window.quit() == 0
