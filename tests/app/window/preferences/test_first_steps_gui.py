"""The first steps in the real window: shown once, closed by a true click, and found again in the Help menu."""

import json

import pytest
from PIL import ImageGrab
from window_driver import WindowDriver, editor_display

pytestmark = pytest.mark.gui


def start(scene, folder, state):
    driver = WindowDriver(scene, folder, state=state, knows_first_steps=None)
    driver.wait_until_open()
    return driver


@pytest.mark.slow
def test_first_steps_are_shown_once_and_on_demand(street_folder, tmp_path):
    state = tmp_path / "state"
    with editor_display():
        window = start(street_folder, tmp_path, state)
        try:
            window.wait_for_widget("first_steps.close")
            window.wait_until_calm()
            ImageGrab.grab().save(tmp_path / "first steps.png")
            left, top, right, bottom = window.state["widgets"]["picture"]
            box = window.state["widgets"]["first_steps.close"]
            assert left < box[0] < box[2] < right
            assert top < box[1] < box[3] < bottom
            window.click_widget("first_steps.close")
            window.wait_for(lambda seen: "first_steps.close" not in seen["widgets"], "the first steps to close")
            assert window.quit() == 0
        finally:
            window.close()
        assert json.loads((state / "preferences.json").read_text())["knows_first_steps"]
        window = start(street_folder, tmp_path, state)
        try:
            assert "first_steps.close" not in window.state["widgets"]
            window.click_widget("menu Help")
            window.click_widget("menu help.first_steps")
            window.wait_for_widget("first_steps.close")
            assert window.quit() == 0
        finally:
            window.close()
