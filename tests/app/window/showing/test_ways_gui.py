"""Another way for what drives, by the Move menu of the real window; what stands still offers none."""

import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR
from window_driver import editor_window

from instdrive_core.formats.registry import open_scene

pytestmark = pytest.mark.gui


def choose(window, name):
    window.click_widget("menu Move")
    window.click_widget(f"menu {name}")


@pytest.mark.slow
def test_the_driving_car_changes_lane_and_is_parked(street_folder, tmp_path):
    with editor_window(street_folder, tmp_path) as window:
        window.click_widget("instances.search")
        window.type("car")
        window.click_widget(f"instances.{DRIVING_CAR}")
        window.wait_for_selection(DRIVING_CAR)
        choose(window, "move.lane_left")
        window.wait_for_edit(f"Drive instance {DRIVING_CAR} another way")
        choose(window, "move.park")
        window.wait_for_edit(f"Park instance {DRIVING_CAR}")
        window.key("ctrl+z")
        window.wait_for(lambda state: state["cursor"] == 2, "parking to be undone")
        window.export(tmp_path / "out")
        old, new = open_scene(street_folder).actors[0], open_scene(tmp_path / "out").actors[0]
        end = float(old.times[-1])
        aside = new.interpolate_pose(end)[:3, 3] - old.interpolate_pose(end)[:3, 3]
        left = -old.interpolate_pose(end)[:3, 0]
        assert 0.1 < aside @ left <= 3.6
        window.click_widget(f"instances.{FIRST_CAR}")
        window.wait_for_selection(FIRST_CAR)
        window.click_widget("menu Move")
        window.click_grey("menu move.park")
        assert window.wait_until_calm()["cursor"] == 3, "what is parked is not parked again"
        window.key("Escape")
        assert window.quit() == 0
