"""Kept views and screenshots in the real window, with true keys and mouse events; a project brings the views back."""

import numpy as np
import pytest
from PIL import Image
from window_driver import editor_window

pytestmark = pytest.mark.gui


def is_near(state, other):
    return np.allclose(state["camera"]["world_from_camera"], other["camera"]["world_from_camera"], atol=1e-6)


@pytest.mark.slow
def test_views_are_kept_and_pictures_taken(street_folder, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    (tmp_path / "Pictures").mkdir()
    project = tmp_path / "kept.instdrive"
    with editor_window(street_folder, tmp_path) as window:
        start = window.wait_until_calm()
        window.key("shift+v")
        window.wait_for(lambda state: state["bookmarks"] == ["View 1"], "Shift+V to keep the view")
        window.key("shift+Home")
        above = window.wait_for(lambda state: not is_near(state, start), "the view from above")
        window.key("shift+v")
        window.wait_for(lambda state: len(state["bookmarks"]) == 2, "the second view")
        window.key("Prior")
        window.wait_for(lambda state: is_near(state, start), "Page Up to go back")
        window.key("alt+7")
        window.click_widget("views.go.1")
        window.wait_for(lambda state: is_near(state, above), "the small picture to lead back")
        window.key("shift+F2")
        window.wait_for_widget("views.name.1")
        window.key("ctrl+a")
        window.type("from above")
        window.tap("Return")
        window.wait_for(lambda state: state["bookmarks"] == ["View 1", "from above"], "the new name")
        window.key("F12")
        window.wait_for_message("_001.png")
        window.key("shift+F12")
        window.wait_for_message("_002.png")
        assert window.state["unsaved"]
        window.key("ctrl+s")
        window.enter_path(project)
        window.wait_for_message(f"Saved {project}")
        left, top, right, bottom = window.state["widgets"]["picture"]
        assert window.quit() == 0
    sizes = []
    for path in sorted((tmp_path / "Pictures").iterdir()):
        with Image.open(path) as picture:
            sizes.append(picture.size)
    assert sizes == [(int(right - left), int(bottom - top)), (2 * int(right - left), 2 * int(bottom - top))]

    (tmp_path / "again").mkdir()
    with editor_window(project, tmp_path / "again") as window:
        window.key("alt+7")
        window.click_widget("views.go.0")
        window.wait_for(lambda state: is_near(state, start), "the kept view of the project")
        window.click_widget("views.delete.1")
        window.wait_for(lambda state: state["bookmarks"] == ["View 1"], "a view to be deleted")
        assert window.quit() == 0
