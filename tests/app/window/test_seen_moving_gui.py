"""Things seen moving are listed below the instances; a true click looks through the photo that shows one."""

from dataclasses import replace

import pytest
from procedural_street import procedural_street
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
