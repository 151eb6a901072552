"""Wipe, flicker and heat map of splats and photo, through the real window."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from procedural_street import FIRST_CAR, procedural_street
from window_driver import editor_window

from instdrive_core.formats.registry import save_scene
from instdrive_core.rasterize.pictures import draw_picture

pytestmark = pytest.mark.gui


@pytest.fixture
def window(tmp_path):
    """The window on a street whose photos show just what the splats show."""
    scene, views = procedural_street(), []
    for view in scene.views[:2]:
        photo = tmp_path / "clip" / view.name / f"{view.index:02d}.png"
        photo.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(draw_picture(scene, view.camera, view.time, "color")).save(photo)
        views.append(replace(view, photo=str(photo)))
    scene.views = tuple(views)
    save_scene(tmp_path / "scene", scene)
    with editor_window(tmp_path / "scene", tmp_path) as driver:
        yield driver


def test_wipe_flicker_and_heat_map(window):
    window.click_widget("view.wipe")
    window.wait_for(lambda state: state["reference"]["kind"] == "PHOTO", "the wipe to show the photo")
    left, top, right, bottom = window.wait_for_rect("viewport.wipe")
    start = ((left + right) / 2, (top + bottom) / 2)
    pose = window.state["camera"]["world_from_camera"]
    window.drag(start, (start[0] - 200, start[1] + 40))
    state = window.wait_for(lambda state: state["reference"]["wipe"] < 0.4, "the line to follow the mouse")
    assert state["camera"]["world_from_camera"] == pose, "the line was dragged, not the camera"

    window.click_widget("view.flicker")
    window.wait_for(lambda state: state["reference"]["comparison"] == "FLICKER", "flicker")
    window.click_widget("view.error")
    equal = window.wait_for(lambda state: state["reference"]["psnr"] is not None, "the difference")
    assert equal["reference"]["psnr"] > 45, "photos are rounded to 8 bits, nothing else differs"
    window.wait_for_rect("viewport.difference")
    window.click_widget(f"instances.{FIRST_CAR}")
    window.key("Delete")
    window.wait_for(lambda state: FIRST_CAR not in state["visible"], "the car to be gone")
    window.wait_for(
        lambda state: state["reference"]["psnr"] is not None and state["reference"]["psnr"] < 40, "the photo to differ"
    )
    window.key("Shift+p")
    masks = window.wait_for(lambda state: state["reference"]["kind"] == "MASKS", "the masks")
    assert masks["reference"]["comparison"] == "OVER", "masks have no heat map"
    window.click_widget("view.error")
    window.click_widget("view.error")
    window.wait_for(lambda state: state["reference"]["comparison"] == "OVER", "the heat map to be left")
    assert window.quit() == 0


def test_the_difference_is_of_colours(window):
    window.key("2")
    window.click_widget("view.error")
    state = window.wait_for(lambda state: state["reference"]["psnr"] is not None, "the difference")
    assert state["view_mode"] == "COLOR"
    assert np.isfinite(state["reference"]["psnr"])
    assert window.quit() == 0
