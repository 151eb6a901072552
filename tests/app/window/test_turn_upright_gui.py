"""A scene of another program, lying on its side: the real window says so, and turns it upright."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import ImageGrab
from window_driver import editor_window

from instdrive_core.formats.registry import open_scene

pytestmark = pytest.mark.gui
BIKER = Path(__file__).parents[4] / "shared/data/splats/biker.spz"
UPRIGHT = np.float32([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
"""What the right of row vectors turns y down to z up."""
BACKGROUND = np.array([14, 16, 20])
KEEP = "INSTDRIVE_KEEP_SCREENSHOTS"
"""Names a folder where screenshots stay."""


def screenshot(folder, name):
    """The window, as an array; kept where that is asked for."""
    picture = ImageGrab.grab(xdisplay=os.environ["DISPLAY"]).convert("RGB")
    picture.save(Path(os.environ.get(KEEP, folder)) / f"{name}.png")
    return np.asarray(picture)


def differs(picture, low, high):
    """The share of a rectangle that is no background."""
    (left, top), (right, bottom) = low.astype(int), high.astype(int)
    part = picture[max(top, 0) : bottom, max(left, 0) : right].astype(int)
    return (np.abs(part - BACKGROUND).max(axis=2) > 20).mean()


def test_a_biker_on_his_back_stands_up_and_lies_down_again(tmp_path):
    if not BIKER.exists():
        pytest.skip("the shared example files are not here")
    means = open_scene(BIKER).gaussians.means
    with editor_window(BIKER, tmp_path) as window:
        window.wait_for_message("This scene seems to lie on its side: −Y is up")
        window.wait_until_calm()
        screenshot(tmp_path, "biker_lying")
        window.key("ctrl+p")
        window.type("upright")
        window.tap("Return")
        window.wait_for_widget("dialog.accept")
        window.wait_until_calm()
        screenshot(tmp_path, "biker_dialog")
        window.click_widget("dialog.accept")
        window.wait_for_edit("Turn the scene, −Y up")
        window.wait_until_calm()
        standing = screenshot(tmp_path, "biker_standing")
        low, high = np.percentile(window.pixels_of(means @ UPRIGHT)[::100], [2, 98], axis=0)
        width, height = high - low
        assert height > 1.5 * width, "he is seen from the side, and tall"
        assert differs(standing, low, high) > 0.3
        assert differs(standing, low - [1.5 * width, 0], high - [1.5 * width, 0]) < 0.05
        head = window.pixel_of(UPRIGHT.T @ means[means[:, 1].argmin()])
        assert head[1] < low[1] + 0.1 * height
        window.export(tmp_path / "upright.ply")
        window.key("ctrl+z")
        window.wait_for(lambda state: state["cursor"] == 0, "the turn to be undone")
        assert window.quit() == 0
    np.testing.assert_array_equal(open_scene(tmp_path / "upright.ply").gaussians.means, means @ UPRIGHT)
