"""A large scene in the real window: its sketch can be looked around in while the whole is being read."""

import dataclasses

import numpy as np
import pytest
from procedural_street import procedural_street
from slow_editor import GO
from window_driver import editor_window

from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.formats.registry import save_scene

pytestmark = pytest.mark.gui


def test_one_looks_around_in_a_sketch_while_the_scene_is_read_or_leaves_it(tmp_path):
    scene = dataclasses.replace(freeze_at_time(procedural_street(), 0.0), sky=None, views=())
    save_scene(tmp_path / "street.ply", scene)
    with editor_window(tmp_path / "street.ply", tmp_path, opens=False, program="slow_editor.py") as window:
        state = window.wait_for(lambda state: state.get("sketch") and state["sketch"]["drawn"], "the sketch")
        assert not state["open"]
        assert "opening" in state["widgets"]
        assert state["sketch"]["splats"] == 2000 < len(scene) / 2
        left, top, right, bottom = state["widgets"]["picture"]
        middle = ((left + right) / 2, (top + bottom) / 2)
        window.drag(middle, (middle[0] + 120, middle[1] + 30))
        turned = window.wait_for(lambda now: now["sketch"]["pose"] != state["sketch"]["pose"], "the camera to turn")
        window.click(*middle)
        window.wait_for_message("Please wait until the whole scene has been read")
        window.click_grey("menu File")
        window.wait_for_frames(4)
        assert "menu file.open" not in window.state["widgets"], "menus wait, too"
        pose = window.wait_until_calm()["sketch"]["pose"]
        assert pose != state["sketch"]["pose"], turned
        (tmp_path / GO).touch()
        opened = window.wait_until_open()
        assert opened["sketch"] is None
        assert len(opened["visible"]) == len(scene.table)
        np.testing.assert_allclose(opened["camera"]["world_from_camera"], pose, err_msg="the user stays there")

        (tmp_path / GO).unlink()
        window.key("ctrl+o")
        window.enter_path(tmp_path / "street.ply")
        window.wait_for(lambda now: now["sketch"] and now["sketch"]["drawn"], "the sketch, beside an open scene")
        window.wait_until_calm()
        window.key("Delete")
        window.wheel(*middle, 3)
        window.click_widget("progress.cancel")
        window.wait_for_message("Opening street.ply was cancelled")
        left = window.wait_for(lambda now: now["sketch"] is None and now["settled"], "the scene before")
        np.testing.assert_allclose(left["camera"]["world_from_camera"], pose)
        assert not left["history"]
        assert window.quit() == 0
