"""The camera's path in the real window: keys by key and mouse, the preview, the film, and the project."""

import os

import av
import numpy as np
import pytest
from PIL import Image
from window_driver import editor_window

pytestmark = pytest.mark.gui


def is_near(state, other):
    return np.allclose(state["camera"]["world_from_camera"], other["camera"]["world_from_camera"], atol=1e-6)


def export_film(window, path, mode, ending):
    """Export by the dialog: 320 × 180 pixels."""
    window.key("alt+F12")
    window.click_widget("export.format")
    window.click_widget(f"export.format.{ending}")
    window.click_widget("export.film.mode")
    window.click_widget(f"export.film.mode.{mode}")
    left, top, right, bottom = window.wait_for_rect("export.film.size")
    for x, side in ((left + 10, 320), (right - 10, 180)):
        window.double_click(x, (top + bottom) / 2)
        window.key("ctrl+a")
        window.type(str(side))
        window.key("Tab")
    window.click_widget("dialog.path")
    window.enter_path(path)
    window.wait_for_message(f"to {path}")


@pytest.mark.slow
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

        window.click_widget("path.strip.0")
        window.wait_for(lambda state: is_near(state, start), "the first key's view")
        left, top, right, bottom = window.wait_for_rect("path.strip.1")
        x, y = (left + right) / 2, (top + bottom) / 2
        first = window.wait_for_widget("path.strip.0")[0]
        window.drag((x, y), ((first + x) / 2, y))
        moved = window.wait_for(lambda state: 0.9 < state["path_keys"][1] < 1.1, "the second key at one second")
        assert is_near(moved, above)
        window.key("ctrl+z")
        window.wait_for(lambda state: state["path_keys"] == [0.0, 2.0], "Ctrl+Z to undo the drag as one step")
        window.key("ctrl+y")
        window.wait_for(lambda state: state["path_keys"] == moved["path_keys"], "Ctrl+Y to do it again")
        window.click_widget("path.strip.0")
        window.wait_for(lambda state: is_near(state, start), "the first key's view again")
        window.key("shift+space")
        between = [state for state in window.states() if state["open"] and state["camera"]]
        window.wait_for(lambda state: not is_near(state, above), "the preview to begin")
        window.wait_for(lambda state: is_near(state, above), "the preview to reach its end")
        played = [state for state in window.states()[len(between) :] if state["camera"]]
        assert any(not is_near(state, start) and not is_near(state, above) for state in played)

        export_film(window, tmp_path / "frames", "color", "")
        export_film(window, tmp_path / "film.webm", "instance", ".webm")
        assert window.state["unsaved"]
        window.key("ctrl+s")
        window.enter_path(project)
        window.wait_for_message(f"Saved {project}")
        kept = window.state["path_keys"]
        assert window.quit() == 0
    frames = sorted(os.listdir(tmp_path / "frames"))
    assert len(frames) == int(kept[1] * 30 + 1e-6) + 1
    with Image.open(tmp_path / "frames" / frames[0]) as picture:
        assert picture.size == (320, 180)

    with av.open(tmp_path / "film.webm") as video:
        shown = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert len(shown) == len(frames)
    assert shown[0].shape == (180, 320, 3)

    (tmp_path / "again").mkdir()
    with editor_window(project, tmp_path / "again") as window:
        assert window.wait_for(lambda state: state.get("path_keys"), "the project's path")["path_keys"] == kept
        assert window.quit() == 0
