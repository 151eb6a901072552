"""A display with two pixels of the screen for one of the window: what is pointed at is what is shown there."""

import numpy as np
import pytest
from PIL import Image
from procedural_street import FIRST_CAR, procedural_street
from window_driver import editor_window

pytestmark = pytest.mark.gui

BLUE_CAR = FIRST_CAR + 1
BLUE_CAR_BACK = (3.0, 5.7, 0.7)
BLUE_CORNERS = [(x, y, z) for x in (2.0, 4.0) for y in (5.7, 10.3) for z in (0.0, 1.6)]
SIZE = (1920, 1080)
"""Pixels of the screen."""


@pytest.mark.slow
def test_clicks_lassos_handles_and_pictures_of_a_dense_display(street_folder, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    (tmp_path / "Pictures").mkdir()
    with editor_window(street_folder, tmp_path, size=SIZE, density=2) as window:
        left, top, right, bottom = window.wait_until_calm()["widgets"]["picture"]
        sharp = 2 * int(right - left), 2 * int(bottom - top)
        assert (window.state["camera"]["width"], window.state["camera"]["height"]) == sharp
        window.move(*window.pixel_of(BLUE_CAR_BACK))
        window.wait_for(lambda state: state["hovered"] == BLUE_CAR, "the blue car to be hovered")
        x, y = window.pixel_of(BLUE_CAR_BACK)
        label = window.wait_for_rect("hover label")
        assert label[0] < x + 40 < label[2] + 80, "the label is beside the pointer"
        assert 0 < label[1] - y < 40
        window.click(x, y)
        window.wait_for_selection(BLUE_CAR)
        window.key("F12")
        window.wait_for_message("_001.png")

        window.key("t")
        street = procedural_street()
        car = street.gaussians.means[street.instance_ids == BLUE_CAR]
        x, y = window.pixel_of((car.min(axis=0) + car.max(axis=0)) / 2)
        center = window.wait_for_widget("gizmo.center")
        assert np.hypot(center[0] - x, center[1] - y) < 12, "the handles are at the car"
        x, y = window.wait_for_widget("gizmo.x")
        window.drag((x, y), (x + 40, y))
        window.wait_for_edit("Move")
        for _ in range(2):
            window.key("ctrl+z")
        window.wait_for_selection()

        window.key("l")
        pixels = window.pixels_of(BLUE_CORNERS)
        middle, radius = pixels.mean(axis=0), 0.62 * np.ptp(pixels, axis=0)
        angles = np.linspace(0, 2 * np.pi, 24)
        path = np.c_[middle[0] + radius[0] * np.cos(angles), middle[1] + radius[1] * np.sin(angles)]
        window.drag_along(np.minimum(path, [right - 3, bottom - 3]).tolist())
        state = window.wait_for(lambda state: BLUE_CAR in state["selected"], "the lasso to take the blue car")
        assert FIRST_CAR not in state["selected"]
        assert window.quit() == 0
    (path,) = (tmp_path / "Pictures").iterdir()
    with Image.open(path) as picture:
        assert picture.size == sharp
