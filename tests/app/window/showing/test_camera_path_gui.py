"""The camera's path in the real window: keys by key and mouse, the preview, the film, and the project."""

import os

import numpy as np
import pytest
from PIL import Image
from window_driver import editor_window

pytestmark = pytest.mark.gui


def is_near(state, other):
    return np.allclose(state["camera"]["world_from_camera"], other["camera"]["world_from_camera"], atol=1e-6)


def test_a_path_is_made_played_filmed_and_kept(street_folder, tmp_path):
    project = tmp_path / "filmed.instdrive"
    with editor_window(street_folder, tmp_path) as window:
        start = window.wait_until_calm()
        window.key("shift+k")
        window.wait_for(lambda state: state["path_keys"] == [0.0], "the first key")
        window.key("shift+Home")
        above = window.wait_for(lambda state: not is_near(state, start), "the view from above")
        window.key("shift+k")
        window.wait_for(lambda state: state["path_keys"] == [0.0, 2.0], "the second key")

        window.click_widget("path.key.0")
        window.wait_for(lambda state: is_near(state, start), "the first key's view")
        left, top, right, bottom = window.wait_for_rect("path.key.1")
        x, y = (left + right) / 2, (top + bottom) / 2
        first = window.wait_for_widget("path.key.0")[0]
        window.drag((x, y), ((first + x) / 2, y))
        moved = window.wait_for(lambda state: 0.9 < state["path_keys"][1] < 1.1, "the second key at one second")
        assert is_near(moved, above)
        window.key("shift+space")
        between = [state for state in window.states() if state["open"] and state["camera"]]
        window.wait_for(lambda state: not is_near(state, above), "the preview to begin")
        window.wait_for(lambda state: is_near(state, above), "the preview to reach its end")
        played = [state for state in window.states()[len(between) :] if state["camera"]]
        assert any(not is_near(state, start) and not is_near(state, above) for state in played)

        window.key("alt+F12")
        window.click_widget("export.format")
        window.click_widget("export.format.")
        window.enter_path(tmp_path / "frames")
        window.wait_for_message(f"to {tmp_path / 'frames'}")
        assert window.state["unsaved"]
        window.key("ctrl+s")
        window.enter_path(project)
        window.wait_for_message(f"Saved {project}")
        kept = window.state["path_keys"]
        assert window.quit() == 0
    frames = sorted(os.listdir(tmp_path / "frames"))
    assert len(frames) == int(kept[1] * 30 + 1e-6) + 1
    with Image.open(tmp_path / "frames" / frames[0]) as picture:
        assert picture.size == (1280, 720)

    (tmp_path / "again").mkdir()
    with editor_window(project, tmp_path / "again") as window:
        assert window.wait_for(lambda state: state.get("path_keys"), "the project's path")["path_keys"] == kept
        assert window.quit() == 0
