"""The real window under a virtual display, driven by true mouse and key events; the export read by plyfile."""

from itertools import groupby, pairwise

import numpy as np
import pytest
from plyfile import PlyData
from procedural_street import FIRST_CAR, procedural_street

pytestmark = pytest.mark.gui

RED_CAR, BLUE_CAR = FIRST_CAR, FIRST_CAR + 1
RED_CAR_SIDE, BLUE_CAR_REAR = (-2.1, 4.6, 0.8), (3.4, 5.8, 0.8)
"""World points on the cars that the first camera sees."""


def test_the_main_job(window, tmp_path):
    hover_and_select(window)
    window.key("Delete")
    gone = window.wait_for(lambda state: RED_CAR not in state["visible"], "the red car to be deleted")
    assert gone["selected"] == []
    window.key("ctrl+z")
    window.wait_for(lambda state: RED_CAR in state["visible"], "undo")
    window.key("ctrl+shift+z")
    window.wait_for(lambda state: RED_CAR not in state["visible"], "redo")
    window.click(*window.pixel_of(BLUE_CAR_REAR))
    window.wait_for_selection(BLUE_CAR)
    window.click_widget("inspector.color.orange")
    state = window.wait_for(lambda state: state["history"][-1].startswith("Paint"), "the new colour")
    assert state["cursor"] == len(state["history"])
    exported = tmp_path / "edited.ply"
    window.export(exported)
    check_export(exported, procedural_street())
    assert window.quit() == 0


def hover_and_select(window):
    x, y = window.pixel_of(RED_CAR_SIDE)
    window.move(x, y)
    state = window.wait_for(lambda state: state["hovered"] == RED_CAR, "the red car to be hovered")
    assert "hover label" in state["widgets"]
    assert state["selected"] == []
    window.click(x, y)
    window.wait_for_selection(RED_CAR)


def check_export(path, scene):
    """An independent reader finds the red car gone, the blue car in other colours, the rest bit by bit as it was."""
    vertices = PlyData.read(path)["vertex"].data
    still = scene.nodes == 0  # the driving car is written where it is at the moment shown
    before = scene.gaussians.select(still)
    kept = scene.instance_ids[still] != RED_CAR
    ids, static = vertices["instance_id"], vertices["instance_id"] != scene.instance_ids[scene.nodes == 1][0]
    assert len(vertices) == len(scene) - (~kept).sum()
    assert not (ids == RED_CAR).any()
    found = vertices[static]
    np.testing.assert_array_equal(found["instance_id"], scene.instance_ids[still][kept])
    columns = {"x": before.means[:, 0], "rot_0": before.quats[:, 0], "scale_1": before.log_scales[:, 1]}
    columns |= {"y": before.means[:, 1], "z": before.means[:, 2], "opacity": before.opacity_logits}
    for name, values in columns.items():
        np.testing.assert_array_equal(found[name], values[kept], err_msg=name)
    blue = found["instance_id"] == BLUE_CAR
    for channel in range(3):
        colors, old = found[f"f_dc_{channel}"], before.sh_dc[kept, channel]
        np.testing.assert_array_equal(colors[~blue], old[~blue])
        assert 0.6 < (colors[blue] != old[blue]).mean() < 0.95, "the body is painted, glass and tyres are not"
    means = [found[f"f_dc_{channel}"][blue].mean() for channel in range(3)]
    assert means[0] > means[1] > means[2], "the blue car became orange"


def test_modifiers_the_list_and_the_menu(window):
    red, blue = window.pixel_of(RED_CAR_SIDE), window.pixel_of(BLUE_CAR_REAR)
    window.click(*red)
    window.wait_for_selection(RED_CAR)
    window.click(*blue, "shift")
    window.wait_for_selection(RED_CAR, BLUE_CAR)
    window.click(*red, "ctrl")
    window.wait_for_selection(BLUE_CAR)
    window.click(*red, "alt")
    window.wait_for_selection(RED_CAR, BLUE_CAR)
    window.key("Escape")
    window.wait_for_selection()
    window.click_widget(f"instances.{BLUE_CAR}")
    window.wait_for_selection(BLUE_CAR)
    window.click_widget(f"instances.{RED_CAR}.eye")
    window.wait_for(lambda state: RED_CAR not in state["visible"], "the eye to hide")
    window.key("alt+h")
    window.wait_for(lambda state: RED_CAR in state["visible"], "everything to be shown")
    window.click(*red, button=3)
    window.click_widget("menu.delete")
    window.wait_for(lambda state: RED_CAR not in state["visible"], "the menu to delete")
    window.click_widget("instances.search")
    window.type("blu")  # typing must not run shortcuts
    assert window.state["view_mode"] == "COLOR"


def test_views_cameras_and_navigation(window):
    for key, mode in (("2", "INSTANCE"), ("3", "CODEWORD"), ("4", "DEPTH"), ("1", "COLOR")):
        window.key(key)
        window.wait_for(lambda state, mode=mode: state["view_mode"] == mode, mode)
    start = window.state["camera"]["world_from_camera"]
    left, top, right, bottom = window.state["widgets"]["viewport"]
    middle = ((left + right) / 2, (top + bottom) / 2)
    window.drag(middle, (middle[0] + 120, middle[1] + 10))
    turned = window.wait_for(lambda state: state["camera"]["world_from_camera"] != start, "the camera to orbit")
    assert turned["selected"] == [], "a drag is no click"
    window.key("Right")
    later = window.wait_for(lambda state: state["time"] > 0, "the next time step")
    assert later["time"] == pytest.approx(0.5)
    window.click_widget("timeline.camera")
    window.click_widget("timeline.camera.right_camera")
    side = procedural_street().views[3].camera.world_from_camera
    window.wait_for(
        lambda state: np.allclose(state["camera"]["world_from_camera"], side), "the right camera at that time"
    )
    window.key("F1")
    window.click_widget("dialog.cancel")
    assert window.quit() == 0


def test_the_drive_plays_around_the_end_and_stops(window):
    window.key("space")
    window.wait_for(lambda state: state["time"] > 0, "the drive to play")
    window.wait_for(lambda _: moments(window).count(0.0) > 1, "a second round")
    window.click_widget("time.play")
    seen = moments(window)
    following = {0.0: 0.5, 0.5: 1.0, 1.0: 1.5, 1.5: 0.0}
    assert all(following[now] == later for now, later in pairwise(seen)), f"a step was left out: {seen}"
    stopped = window.wait_until_calm(1.0)["time"]
    window.click_widget("time.previous")
    window.wait_for(lambda state: following[state["time"]] == stopped, "the step before")
    _, top, right, bottom = window.state["widgets"]["timeline.slider"]
    window.click(right - 6, (top + bottom) / 2)
    window.wait_for(lambda state: state["time"] == 1.5, "the slider to go to the last step")
    assert window.quit() == 0


def moments(window):
    """The times that the window has shown, each once for as long as it lasted."""
    times = [state["time"] for state in window.states() if state["open"]]
    return [time for time, _ in groupby(times)]
