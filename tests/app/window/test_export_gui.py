"""Exporting through the real window: the whole scene by a typed path, the selection and masks by the dialog's lists.

Edits of what drives are handed over to NuRec the same way.
"""

import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, procedural_street
from window_driver import editor_window

from instdrive_core.formats.nurec.edit_assets import read_asset_edits
from instdrive_core.formats.registry import open_scene, save_scene

pytestmark = pytest.mark.gui


@pytest.fixture
def window(tmp_path):
    """The window on a street of its own folder, beside which exports are proposed."""
    save_scene(tmp_path / "street", procedural_street(0.3))
    with editor_window(tmp_path / "street", tmp_path) as driver:
        yield driver


@pytest.mark.slow
def test_selection_scene_and_masks(window, tmp_path):
    scene = procedural_street(0.3)
    count = scene.table[FIRST_CAR].count
    window.click_widget(f"instances.{FIRST_CAR}")
    window.wait_for_selection(FIRST_CAR)
    window.key("ctrl+shift+e")
    window.click_widget("export.format")
    window.click_widget("export.format..spz")
    window.click_widget("dialog.accept")
    proposed = tmp_path / "street_parked_car_1.spz"
    window.wait_for_message(f"Exported {count:,} splats to {proposed}, read back and compared")
    assert len(open_scene(proposed)) == count

    whole = tmp_path / "whole.splat"
    window.key("ctrl+e")
    window.enter_path(whole)
    window.wait_for_message(f"Exported {len(scene):,} splats to {whole}")
    assert len(open_scene(whole)) == len(scene)

    window.key("ctrl+e")
    window.click_widget("export.what")
    window.wait_for_widget("export.what.masks")
    window.key("Escape")
    left = window.wait_for(lambda state: "export.what.masks" not in state["widgets"], "the list to close")
    assert "dialog.path" in left["widgets"], "the list goes before the dialog"
    window.click_widget("export.what")
    window.click_widget("export.what.masks")
    window.click_widget("dialog.accept")
    window.wait_for_message(f"masks of {len(scene.views)} photos to {tmp_path / 'street_masks'}")
    assert (tmp_path / "street_masks" / "instances.json").is_file()

    window.click_widget("instances.search")
    window.type("driving")
    window.click_widget(f"instances.{DRIVING_CAR}")
    window.wait_for_selection(DRIVING_CAR)
    window.key("Delete")
    window.wait_for_edit("Delete")
    window.key("ctrl+e")
    window.click_widget("export.what")
    window.click_widget("export.what.nurec")
    window.wait_for_widget("export.nurec.tracks")
    window.click_widget("export.nurec.tracks")
    window.paste(str(tmp_path / "none.json"))
    window.click_widget("dialog.accept")
    window.wait_for_message("none.json")
    handed = tmp_path / "street_nurec"
    assert not handed.exists()
    window.key("ctrl+e")
    window.click_widget("export.what")
    window.click_widget("export.what.nurec")
    window.click_widget("dialog.accept")
    window.wait_for_message(f"Handed over to {handed}: actors: 1 removed, 0 replaced, 0 inserted")
    assert read_asset_edits(handed / "edit-assets.json").removed == ("driver",)
    assert window.quit() == 0
