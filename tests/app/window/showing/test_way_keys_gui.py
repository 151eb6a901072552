"""Keys of a way in the real window: dragged in the view, on the map, on the timeline and in the graph of the speed."""

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR
from test_map_gui import find_on_map
from window_driver import editor_window

from instdrive_core.formats.registry import open_scene

pytestmark = pytest.mark.gui


def drag_by(window, widget, dx, dy):
    x, y = window.wait_for_widget(widget)
    window.drag((x, y), (x + dx, y + dy))


def carry_a_way_through_a_scenario(window, path, driven):
    """All ways go into an OpenSCENARIO file; the selected thing gets another way, and that of the file again."""
    window.key("ctrl+e")
    window.click_widget("export.what")
    window.click_widget("export.what.objects")
    window.click_widget("dialog.path")
    window.enter_path(path)
    window.wait_for_message(f"to {path}")
    window.wait_until_calm()
    window.click(*find_on_map(window, 0.6, 22.0))  # ahead of the driving car: a click on that would select it
    window.wait_for(lambda state: len(state["way_keys"]) == len(driven) + 1, "a longer way")
    window.click_widget("menu Move")
    window.click_widget("menu way.read")
    window.enter_path(path)
    window.wait_for(lambda state: state["way_keys"] and state["way_keys"][-1][1] < 0, "the way of the file")
    assert window.state["way_keys"][-1][1:] == pytest.approx(driven[-1][1:], abs=0.1)


@pytest.mark.slow
def test_a_way_is_edited_everywhere_and_kept(street_folder, tmp_path):
    project = tmp_path / "ways.instdrive"
    with editor_window(street_folder, tmp_path) as window:
        window.key("shift+Home")  # before anything is selected: everything from above
        window.click_widget("instances.search")
        window.type("car")
        window.click_widget(f"instances.{DRIVING_CAR}")
        window.wait_for_selection(DRIVING_CAR)
        window.key("alt+m")
        window.key("shift+t")
        start = window.wait_for(lambda state: state["tool"] == "path", "the path tool")["way_keys"]
        assert len(start) == 2

        window.wait_until_calm()
        drag_by(window, "gizmo.way.1", 25, -8)
        state = window.wait_for_edit(f"Drive instance {DRIVING_CAR} another way")
        seen = state["way_keys"]
        assert np.hypot(seen[1][1] - start[1][1], seen[1][2] - start[1][2]) > 0.5
        assert seen[0] == start[0]
        cursor = state["cursor"]

        find_on_map(window, 0.0, 10.0)
        drag_by(window, "gizmo.map.way.1", -20, 0)
        state = window.wait_for(lambda state: state["cursor"] == cursor + 1, "one step for the drag on the map")
        assert state["way_keys"][1][1] < seen[1][1] - 0.5
        assert state["way_keys"][1][0] == seen[1][0], "the time stays"

        drag_by(window, "gizmo.timeline.way.0", 80, 0)
        state = window.wait_for(lambda state: state["cursor"] == cursor + 2, "one step for the drag in time")
        assert state["way_keys"][0][0] > 0.1, "it starts later"
        assert state["way_keys"][0][1:] == seen[0][1:]

        window.key("alt+w")
        x, y = window.wait_for_widget("gizmo.way.key.0")
        right = window.wait_for_widget("gizmo.way.key.1")[0]
        window.double_click((x + right) / 2, y - 60)
        window.wait_for(lambda state: len(state["way_keys"]) == 3, "a double click to add a key")
        kept = window.wait_until_calm()["way_keys"]
        drag_by(window, "gizmo.way.speed.1", 0, 40)
        state = window.wait_for(lambda state: state["cursor"] == cursor + 4, "one step for the drag of the speed")
        assert np.hypot(*np.subtract(state["way_keys"][-1][1:], kept[-1][1:])) > 0.2, "slower: it gets less far"
        window.key("ctrl+z")
        window.wait_for(lambda state: state["way_keys"] == kept, "undo")

        window.click_widget(f"instances.{FIRST_CAR}")
        window.wait_for_selection(FIRST_CAR)
        window.click(*find_on_map(window, -1.0, 12.0))
        state = window.wait_for_edit("Let ")
        assert len(state["way_keys"]) == 2
        assert state["way_keys"][1][1:] == pytest.approx([-1.0, 12.0], abs=0.3)
        window.key("ctrl+s")
        window.enter_path(project)
        window.wait_for_message(f"Saved {project}")
        driven = window.state["way_keys"]
        window.export(tmp_path / "out")
        carry_a_way_through_a_scenario(window, tmp_path / "ways.xosc", driven)
        assert window.quit() == 0
    assert len(open_scene(tmp_path / "out").actors) == 2
    (tmp_path / "again").mkdir()
    with editor_window(project, tmp_path / "again") as window:
        state = window.wait_for(lambda state: state.get("way_keys"), "the project's way")
        assert np.allclose(state["way_keys"], driven)
        assert window.quit() == 0
