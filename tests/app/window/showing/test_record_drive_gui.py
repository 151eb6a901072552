"""Recording the drive through the real window: the dialog, a job that is cancelled, and one that goes on and ends."""

import json

import pytest
from procedural_street import FIRST_CAR as CAR
from window_driver import editor_window

from instdrive_core.recording.folder import MANIFEST, PLAN, read_id_map, read_manifest

pytestmark = pytest.mark.gui


def open_dialog(window, folder):
    window.key("ctrl+p")
    window.wait_for_widget("palette.search")
    window.type("record drive")
    window.key("Return")
    window.wait_for_widget("record.folder")
    window.key("ctrl+a")
    window.type(str(folder))


def type_shutter(window, seconds):
    left, top, _, bottom = window.wait_for_rect("record.shutter")  # the label stands right of the number
    window.click(left + 20, (top + bottom) / 2)
    window.key("ctrl+a")
    window.type(seconds)
    window.key("Tab")


def test_an_edited_drive_is_recorded_stopped_and_finished(street_folder, tmp_path):
    folder = tmp_path / "recorded"
    with editor_window(street_folder, tmp_path) as window:
        window.click_widget(f"instances.{CAR}")
        window.wait_for_selection(CAR)
        window.key("Delete")
        window.wait_for(lambda state: CAR not in state["visible"], "the car to be deleted")

        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "notes.txt").write_text("x")
        open_dialog(window, tmp_path / "mine")
        window.wait_for_widget("record.problem")
        window.key("ctrl+a")
        window.type(str(folder))
        window.click_widget("record.layout.coco")
        window.click_widget("record.way")
        window.click_widget("record.way.shift")
        window.wait_for_widget("record.amount")
        window.click_widget("record.video")
        window.click_widget("record.video.mp4")
        type_shutter(window, "7")
        window.wait_for_widget("record.problem")
        type_shutter(window, "0.03")
        window.click_widget("dialog.accept")
        window.wait_for(lambda state: (state["busy"] or "").startswith("Recording"), "the job to begin")
        window.wait_for_widget("progress.cancel")
        window.click_widget("progress.cancel")
        window.wait_for_message("Recording recorded was cancelled")
        assert not (folder / MANIFEST).exists()

        open_dialog(window, folder)
        window.click_widget("dialog.accept")
        window.wait_for_message(f"Recorded {folder}")
        assert window.quit() == 0
    manifest = read_manifest(folder)
    assert manifest["confidence"] is not None, "another way has confidence"
    assert CAR not in {entry["id"] for entry in manifest["instances"]}
    first = manifest["views"][0]
    assert CAR not in read_id_map(folder / f"instances/{first['camera']}/{first['step']:02d}.png")
    assert json.loads((folder / PLAN).read_text())["confidence"]
    assert manifest["shutter"]["seconds"] == 0.03
    assert (folder / f"videos/color/{first['camera']}.mp4").stat().st_size > 1000
    assert (folder / "layouts/coco/drive/instances.json").is_file()
