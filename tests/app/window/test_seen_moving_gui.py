"""Things seen moving are listed below the instances; a true click looks through the photo that shows one.

What passes by says when, and a click goes there.
"""

from dataclasses import replace

import pytest
from procedural_street import DRIVING_CAR, ROAD, procedural_street
from window_driver import editor_window

from instdrive_core.formats.registry import save_scene
from instdrive_core.scene.seen_moving import SeenMover, Sighting

pytestmark = pytest.mark.gui


def test_a_click_on_what_was_seen_moving_looks_through_its_first_photo(tmp_path):
    street = procedural_street()
    shown = street.views[2]
    movers = tuple(
        SeenMover(shown.name, (Sighting(shown.index, (0.2, 0.4, 0.3, 0.6)),), label) for label in ("Car", "", "Bus")
    )
    save_scene(tmp_path / "street", replace(street, seen_movers=movers))
    with editor_window(tmp_path / "street", tmp_path) as window:
        window.click_widget("instances.seen_moving.2")
        window.wait_for(lambda state: state["time"] == shown.time, "the time of the first photo")
        window.click_widget("instances.seen_moving")
        window.wait_for(lambda state: "instances.seen_moving.2" not in state["widgets"], "the list to close")
        assert window.quit() == 0


def test_what_is_not_there_yet_says_when_it_is_and_a_click_goes_there(tmp_path):
    street = procedural_street()
    track = street.actors[0]
    late = replace(track, times=track.times[2:], world_from_box=track.world_from_box[2:])
    save_scene(tmp_path / "street", replace(street, actors=(late,)))
    with editor_window(tmp_path / "street", tmp_path) as window:
        window.click_widget("instances.search")
        window.type(str(DRIVING_CAR))
        window.wait_for(lambda state: f"instances.{ROAD}" not in state["widgets"], "one row in the list")
        window.click_widget(f"instances.{DRIVING_CAR}")
        window.wait_for_selection(DRIVING_CAR)
        window.click_widget("inspector.go_to_time")
        state = window.wait_for(lambda state: state["time"] == 1.0, "the time at which it is there")
        window.wait_for(lambda state: "inspector.go_to_time" not in state["widgets"], "the button to go")
        assert state["selected"] == [DRIVING_CAR]
        assert window.quit() == 0
