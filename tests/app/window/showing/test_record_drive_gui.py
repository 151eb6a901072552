"""Recording the drive through the real window: the dialog, a job that is cancelled, and one that goes on and ends."""

import json

import numpy as np
import pytest
from procedural_street import FIRST_CAR as CAR
from scenario_text import TIMING, VERTEX, write_scenario_text
from window_driver import editor_window

from instdrive_core.formats.registry import open_scene
from instdrive_core.recording.ego_path import find_ego_way
from instdrive_core.recording.folder import MANIFEST, PLAN, read_id_map, read_manifest

pytestmark = pytest.mark.gui


def open_dialog(window, folder):
    window.key("ctrl+p")
    window.wait_for_widget("palette.search")
    window.type("record drive")
    window.tap("Return")
    window.wait_for_widget("record.folder")
    window.key("ctrl+a")
    window.paste(str(folder))


def write_way(scene, folder):
    """A way two metres beside the recorded one, as OpenSCENARIO."""
    opened = open_scene(scene)
    way = find_ego_way(opened.views)
    left = way.world_from_box[:, :3, 3] - 2.0 * way.world_from_box[:, :3, 0] + opened.origin
    write_scenario_text(
        folder,
        "".join(VERTEX.format(time, *place[:2], "") for time, place in zip(way.times.tolist(), left, strict=True)),
        TIMING.format("absolute").replace('offset="0.5"', 'offset="0"'),
    )


def type_shutter(window, seconds):
    left, top, _, bottom = window.wait_for_rect("record.shutter")  # the label stands right of the number
    window.click(left + 20, (top + bottom) / 2)
    window.key("ctrl+a")
    window.type(seconds)
    window.key("Tab")


@pytest.mark.slow
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
        window.paste(str(folder))
        window.click_widget("record.layout.coco")
        window.click_widget("record.way")
        window.click_widget("record.way.file")
        window.click_widget("record.way_file")
        window.paste(str(tmp_path / "drive.xosc"))
        window.key("Tab")
        window.wait_for_widget("record.problem")
        write_way(street_folder, tmp_path)
        window.click_widget("record.exr")
        window.click_widget("record.lidar")
        window.click_widget("record.lidar.none")
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
    aside = np.array(first["world_from_camera"])[:3, 3] - open_scene(street_folder).views[0].camera.position
    assert np.linalg.norm(aside) == pytest.approx(2.0, abs=0.1), "as the file says"
    depth = folder / f"depth/{first['camera']}/{first['step']:02d}.exr"
    assert depth.is_file()
    assert not (folder / "lidar").exists()
    assert CAR not in read_id_map(folder / f"instances/{first['camera']}/{first['step']:02d}.png")
    assert json.loads((folder / PLAN).read_text())["confidence"]
    assert manifest["shutter"]["seconds"] == 0.03
    assert (folder / f"videos/color/{first['camera']}.mp4").stat().st_size > 1000
    assert (folder / "layouts/coco/drive/instances.json").is_file()
