"""Keys and mouse presets, chosen and changed in Preferences of the real window with true mouse and keys."""

import json

import numpy as np
import pytest
from window_driver import editor_window

pytestmark = pytest.mark.gui


def open_preferences(window):
    window.key("ctrl+comma")
    window.wait_for_widget("preferences.keys.search")


def close(window):
    window.key("Escape")
    window.wait_for(lambda state: "preferences.keys.search" not in state["widgets"], "Preferences to close")


def ask_for_key(window, words, action, key):
    window.click_widget("preferences.keys.search")
    window.key("ctrl+a")
    window.type(words)
    window.click_widget(f"preferences.key.{action}")
    window.key(key)


@pytest.mark.slow
def test_presets_and_own_keys_work_at_once_and_survive_a_file(street_folder, tmp_path):
    path = tmp_path / "mine.json"
    with editor_window(street_folder, tmp_path) as window:
        open_preferences(window)
        window.click_widget("preferences.preset.blender")
        window.wait_for(lambda state: state["preferences"]["preset"] == "blender", "the preset")
        close(window)
        left, top, right, bottom = window.state["widgets"]["picture"]
        middle = (left + right) / 2, (top + bottom) / 2
        window.move(*middle)
        start = window.wait_until_calm()["camera"]["world_from_camera"]
        window.key("s")
        window.wait_for(lambda state: state["tool"] == "scale", "S to scale, not to fly")
        assert np.allclose(window.state["camera"]["world_from_camera"], start)
        window.drag(middle, (middle[0] + 80, middle[1]), button=2, modifiers=("shift",))
        panned = window.wait_until_calm()["camera"]["world_from_camera"]
        assert np.allclose(np.array(panned)[:3, :3], np.array(start)[:3, :3])
        assert not np.allclose(panned, start)

        open_preferences(window)
        ask_for_key(window, "rotate", "tool.rotate", "ctrl+shift+u")
        window.wait_for(lambda state: state["preferences"]["keys"] == {"tool.rotate": ["Ctrl+Shift+U"]}, "the key")
        ask_for_key(window, "measure", "tool.measure", "ctrl+shift+u")
        window.click_widget("preferences.conflict.take")
        taken = {"tool.rotate": [], "tool.measure": ["Ctrl+Shift+U"]}
        window.wait_for(lambda state: state["preferences"]["keys"] == taken, "the key to go over")
        window.click_widget("preferences.keys.export")
        window.enter_path(path)
        window.wait_for_message(f"Exported the keys to {path}")
        window.key("ctrl+shift+u")
        window.wait_for(lambda state: state["tool"] == "measure", "the new key to measure")
        open_preferences(window)
        window.click_widget("preferences.keys.reset")
        window.wait_for(lambda state: state["preferences"]["keys"] == {}, "all keys to be as they were")
        window.click_widget("preferences.keys.import")
        window.enter_path(path)
        window.wait_for(lambda state: state["preferences"]["keys"] == taken, "the keys of the file")
        assert window.quit() == 0
    assert json.loads(path.read_text()) == {"preset": "blender", "keys": taken}
