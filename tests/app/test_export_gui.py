"""Exporting through the real window: the whole scene by a typed path, the selection and masks by the dialog's lists."""

import shutil

import pytest
from procedural_street import FIRST_CAR, procedural_street
from window_driver import WindowDriver

from instdrive_app.virtual_display import virtual_display
from instdrive_core.formats.registry import open_scene, save_scene

pytestmark = pytest.mark.gui


@pytest.fixture
def window(tmp_path):
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    save_scene(tmp_path / "street", procedural_street(0.3))
    with virtual_display((1280, 720)):
        driver = WindowDriver(tmp_path / "street", tmp_path)
        try:
            driver.wait_for(lambda state: state["open"] and state["settled"], "the scene to be open")
            driver.wait_until_calm()
            yield driver
        finally:
            driver.close()


def wait_for_message(window, text):
    return window.wait_for(lambda state: any(text in message for message in state["messages"]), text)


def test_selection_scene_and_masks(window, tmp_path):
    scene = procedural_street(0.3)
    count = scene.table[FIRST_CAR].count
    window.click_widget(f"instances.{FIRST_CAR}")
    window.wait_for(lambda state: state["selected"] == [FIRST_CAR], "the car to be selected")
    window.key("ctrl+shift+e")
    window.click_widget("export.format")
    window.click_widget("export.format..spz")
    window.click_widget("dialog.accept")
    proposed = tmp_path / "street_parked_car_1.spz"
    wait_for_message(window, f"Exported {count:,} splats to {proposed}, read back and compared")
    assert len(open_scene(proposed)) == count

    whole = tmp_path / "whole.splat"
    window.key("ctrl+e")
    window.wait_for_widget("dialog.path")
    window.key("ctrl+a")
    window.type(str(whole))
    window.click_widget("dialog.accept")
    wait_for_message(window, f"Exported {len(scene):,} splats to {whole}")
    assert len(open_scene(whole)) == len(scene)

    window.key("ctrl+e")
    window.click_widget("export.what")
    window.click_widget("export.what.masks")
    window.click_widget("dialog.accept")
    wait_for_message(window, f"masks of {len(scene.views)} photos to {tmp_path / 'street_masks'}")
    assert (tmp_path / "street_masks" / "instances.json").is_file()
    assert window.quit() == 0
