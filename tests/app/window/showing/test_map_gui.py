"""The map beside the view: zoomed, dragged, clicked and double-clicked in the real window."""

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR

from instdrive_app.session.mapping.map_window import MapWindow

pytestmark = pytest.mark.gui


def find_on_map(window, *place):
    """Where a place of the ground is in the program's window, once the map is painted and at rest."""
    window.wait_for(lambda state: state["map"] and state["map"]["painted"], "the map to be painted")
    state = window.wait_until_calm()
    left, top, _, _ = state["widgets"]["map.canvas"]
    shown = MapWindow(**{name: state["map"][name] for name in ("x", "y", "scale", "width", "height")})
    return tuple((shown.to_pixels(np.array([place]))[0] + (left, top)).tolist())


def test_the_map_zooms_pans_selects_and_leads_there(window):
    window.key("alt+m")
    x, y = find_on_map(window, 0.0, 8.0)
    before = window.state["map"]
    window.wheel(x, y, 2)
    nearer = window.wait_for(lambda state: state["map"]["scale"] < 0.8 * before["scale"], "the wheel to zoom")["map"]
    assert find_on_map(window, 0.0, 8.0) == pytest.approx((x, y), abs=1.5), "the place under the mouse stays"
    window.drag((x, y), (x + 40, y + 25))
    window.wait_for(lambda state: state["map"]["x"] < nearer["x"] - 10 * nearer["scale"], "the drag to pan")
    assert find_on_map(window, 0.0, 8.0) == pytest.approx((x + 40, y + 25), abs=2)
    assert not window.state["selected"], "a drag is no click"
    window.key("ctrl+p")
    window.wait_for_widget("palette.search")
    window.type("everything in the map")
    window.tap("Return")
    window.wait_for(lambda state: state["map"]["scale"] == before["scale"], "the whole map again")

    window.click(*find_on_map(window, 3.0, 8.0))
    window.wait_for_selection(FIRST_CAR + 1)
    window.click_widget(f"gizmo.map.thing.{DRIVING_CAR}")
    window.wait_for_selection(DRIVING_CAR)
    window.click(*find_on_map(window, 0.0, 14.0))
    window.wait_for(lambda state: not state["selected"], "a click on the road to clear the selection")

    target = find_on_map(window, 0.5, 18.0)
    window.double_click(*target)
    window.wait_for(lambda state: state["cameras"]["looked_through"] is None, "the view to go there")
    pose = np.array(window.wait_until_calm()["camera"]["world_from_camera"])
    reach = -pose[2, 3] / pose[2, 2]
    assert np.allclose((pose[:3, 3] + reach * pose[:3, 2])[:2], (0.5, 18.0), atol=0.5)
    assert pose[2, 3] > 0.5

    window.click_widget("map.close")
    window.wait_for(lambda state: state["map"] is None, "the map to be closed")
    assert window.quit() == 0
