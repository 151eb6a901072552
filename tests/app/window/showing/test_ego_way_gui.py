"""A way for the recording car: asked for in the dialog, drawn on the map, and recorded, in the real window."""

import numpy as np
import pytest
from test_map_gui import find_on_map

from instdrive_core.recording.folder import read_manifest

pytestmark = pytest.mark.gui


def open_dialog(window):
    window.key("ctrl+p")
    window.wait_for_widget("palette.search")
    window.type("record drive")
    window.tap("Return")
    window.wait_for_widget("record.folder")


@pytest.mark.slow
def test_a_way_is_drawn_and_recorded(window, tmp_path):
    folder = tmp_path / "recorded"
    open_dialog(window)
    window.click_widget("record.way")
    window.click_widget("record.way.drawn")
    window.wait_for_widget("record.problem")
    window.click_widget("record.draw")
    window.wait_for_widget("ego.drop_last")
    for number, place in enumerate([(-0.6, -1.5), (-1.5, 2.0), (-1.5, 6.0), (3.0, 9.0)], start=1):
        window.click(*find_on_map(window, *place))
        state = window.wait_for(lambda state, number=number: len(state["ego_way"]) == number, "the next place")
        assert np.allclose(state["ego_way"][-1], place, atol=0.15)
    window.click_widget("ego.drop_last")
    window.wait_for(lambda state: len(state["ego_way"]) == 3, "the last place to be gone")
    x, y = window.wait_for_widget("gizmo.map.ego.1")
    window.drag((x, y), (x + 20, y))
    moved = window.wait_for(lambda state: state["ego_way"][1][0] > -0.5, "the place to follow the mouse")["ego_way"]
    assert not window.state["selected"]
    window.click_widget("ego.draw")
    window.wait_for(lambda state: "ego.drop_last" not in state["widgets"], "drawing to end")

    open_dialog(window)
    window.key("ctrl+a")
    window.paste(str(folder))
    window.click_widget("dialog.accept")
    window.wait_for_message(f"Recorded {folder}")
    assert window.quit() == 0
    views = [view for view in read_manifest(folder)["views"] if view["camera"] == "front_camera"]
    places = np.array([view["world_from_camera"] for view in views])[:, :2, 3]
    assert np.allclose(places[0], moved[0], atol=0.01)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert np.allclose(steps, 0.8, atol=0.03), "as fast as recorded"
    assert places[-1, 0] > places[0, 0] + 0.1, "along the drawn way"
