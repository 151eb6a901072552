"""What everybody does in the first minutes, in the real window: alone, Home, paint, export and open again, upright,
holes that wait."""

import time

import numpy as np
import pytest
from parked_street import CAR, OTHER_CAR, WALL, parked_street
from PIL import ImageGrab
from procedural_street import DRIVING_CAR, FIRST_CAR, ROAD, procedural_street
from window_driver import PATIENCE, editor_display, editor_window, start_editor

from instdrive_core.formats.registry import save_scene
from instdrive_core.project.session_folder import JOURNAL
from instdrive_core.scene.scene import scene_from_gaussians

pytestmark = pytest.mark.gui

WHITE_CAR, WHITE_MIDDLE = FIRST_CAR + 2, (-3.0, 12.4, 0.7)
PATCH = 40
"""Pixels of the squares in which the backdrop is looked at."""


def take_picture(window):
    """The viewport's pixels, once it is sharp."""
    state = window.wait_for(lambda state: state["settled"], "a sharp picture")
    left, top, right, bottom = (round(value) for value in state["widgets"]["picture"])
    return np.asarray(ImageGrab.grab().convert("RGB")).astype(int)[top:bottom, left:right]


def find_corner_patches(picture):
    """Squares near three edges of the picture, where no button and no message is."""
    height, width, _ = picture.shape
    places = ((height - 2 * PATCH, 150), (2 * PATCH, width - 2 * PATCH), (height // 2, width - 2 * PATCH))
    return [picture[y : y + PATCH, x : x + PATCH] for y, x in places]


def place(window, field, text):
    window.click_widget(f"inspector.{field}", "ctrl")
    window.key("ctrl+a")
    window.type(text)
    window.tap("Return")


def test_alone_home_turned_painted_exported_and_opened_as_it_was_left(window, tmp_path):
    window.click_widget("timeline.camera")
    window.click_widget("timeline.camera.right_camera")
    window.wait_for(lambda state: state["cameras"]["looked_through"] == 1, "the camera that looks to the right")
    window.click_widget("instances.search")
    window.type("car")
    window.wait_for(lambda state: f"instances.{ROAD}" not in state["widgets"], "cars only in the list")
    window.click_widget(f"instances.{WHITE_CAR}.solo")
    window.wait_for(lambda state: state["visible"] == [WHITE_CAR], "one car alone")
    left, top, right, bottom = window.wait_until_calm()["widgets"]["picture"]
    x, y = window.pixel_of(np.mean(find_rows(procedural_street(), WHITE_CAR), axis=0))
    assert left < x < right, "it was out of view, and is not"
    assert top < y < bottom
    window.move(left + 5, bottom + 60)
    patches = find_corner_patches(take_picture(window))
    assert max(np.ptp(patch.reshape(-1, 3), axis=0).max() for patch in patches) <= 1, "a plain backdrop"
    assert np.ptp([patch.mean(axis=(0, 1)) for patch in patches], axis=0).max() <= 1, "of one colour"
    window.click_widget("instances.leave_solo")
    window.wait_for(lambda state: len(state["visible"]) > 10, "all again")

    window.click_widget("view.color")  # the keys are no longer the search field's
    window.key("Home")
    window.wait_for(lambda state: state["cameras"]["looked_through"] is None, "to look from elsewhere")
    eye = np.array(window.state["camera"]["world_from_camera"])[:3, 3]
    places = [view.camera.position for view in procedural_street().views]
    assert min(np.linalg.norm(eye - place) for place in places) < 1e-6, "from where a photo was taken"
    assert np.linalg.norm(procedural_street().gaussians.means - eye, axis=1).min() > 1.0, "not inside of splats"

    window.click_widget(f"instances.{DRIVING_CAR}")
    before = window.wait_for(lambda state: len(state["way_keys"]) == 2, "the driving car's way")["way_keys"]
    place(window, "yaw", "120")
    window.wait_for_edit("Rotate")
    assert np.allclose(window.wait_until_calm()["way_keys"], before, atol=0.02), "it stays in its lane"
    window.key("ctrl+z")
    window.click_widget("menu Move")
    window.click_widget("menu move.body_only")
    place(window, "yaw", "120")
    window.wait_for(lambda state: not np.allclose(state["way_keys"], before, atol=0.5), "the whole drive to turn")
    window.key("ctrl+z")

    window.click_widget(f"instances.{WHITE_CAR}")
    window.key("f")
    steps = window.wait_until_calm()["cursor"]
    window.key("c")
    window.wait_for_widget("picker.wheel")
    assert window.state["cursor"] == steps, "the key asks for a colour and changes nothing"
    window.key("Escape")
    plain = take_picture(window)
    window.click_widget("inspector.color.red")
    painted = window.wait_for_edit("Paint")["cursor"]
    window.wait_until_calm()
    narrow = np.abs(take_picture(window) - plain).max(axis=2) > 20
    x, y = window.wait_for_widget("inspector.tolerance")
    window.drag((x, y), (x + 60, y))
    window.wait_for(lambda state: state["cursor"] > painted, "the slider to paint again")
    window.wait_until_calm()
    wide = np.abs(take_picture(window) - plain).max(axis=2) > 20
    assert 0.002 < narrow.mean() < wide.mean() < 0.5
    assert window.state["cursor"] == painted + 1, "the slider paints again what was painted last, in one step"

    seen, above = window.state["camera"], take_picture(window)[5:30, -200:-150]
    exported = tmp_path / "left.ply"
    window.export(exported)
    assert window.quit() == 0
    (tmp_path / "again").mkdir()
    with editor_window(exported, tmp_path / "again") as again:
        opened = again.wait_until_calm()
        assert np.allclose(opened["camera"]["world_from_camera"], seen["world_from_camera"], atol=1e-4)
        assert "upright.turn" not in opened["widgets"], "nobody asks which way is up"
        assert np.abs(take_picture(again)[5:30, -200:-150] - above).mean() < 3, "the sky came along"
        assert again.quit() == 0


def find_rows(scene, instance):
    return scene.gaussians.means[scene.instance_ids == instance]


@pytest.mark.slow
def test_holes_wait_through_deletions_undo_moves_saving_and_a_crash(tmp_path):
    save_scene(tmp_path / "parked", parked_street().scene)
    project = tmp_path / "holes.instdrive"

    def wait_for_both(window):
        window.wait_for(lambda state: "deletion.fill_all" in state["widgets"], "two holes to wait", 120)

    with editor_display():
        window = start_editor(tmp_path / "parked", tmp_path, "first")
        try:
            window.click_widget(f"instances.{CAR}")
            window.key("Delete")
            window.wait_for_widget("deletion.fill")
            window.click_widget(f"instances.{OTHER_CAR}")
            window.key("Delete")
            wait_for_both(window)
            window.key("ctrl+z")
            window.wait_for(lambda state: OTHER_CAR in state["visible"], "undo")
            window.wait_for(lambda state: "deletion.fill_all" not in state["widgets"], "one hole to go")
            assert "deletion.fill" in window.wait_until_calm()["widgets"], "and the other to stay"
            window.click_widget(f"instances.{OTHER_CAR}")
            window.wait_for_selection(OTHER_CAR)
            place(window, "x", "-2")
            wait_for_both(window)
            window.key("ctrl+s")
            window.enter_path(project.with_suffix(""))
            window.wait_for_message(f"Saved {project}")
            assert window.quit() == 0
        finally:
            window.close()
        window = start_editor(project, tmp_path, "second")
        try:
            wait_for_both(window)
            window.click_widget(f"instances.{WALL}.eye")
            window.wait_for(lambda state: WALL not in state["visible"], "an edit that is not saved")
            wait_until_kept(tmp_path / "state" / "recovery")
            window.kill()
        finally:
            window.close()
        window = start_editor(tmp_path / "parked", tmp_path, "third")
        try:
            window.click_widget("recovery.0.recover")
            wait_for_both(window)
            window.click_widget("deletion.fill_all")
            window.wait_for(
                lambda state: sum(title.startswith("Fill hole") for title in state["history"]) == 2, "both to be filled"
            )
            assert window.quit() == 0
        finally:
            window.close()


def wait_until_kept(recovery):
    """The editor writes what was done within a second, on a thread of its own."""
    end = time.monotonic() + PATIENCE
    while not any("hide" in journal.read_text() for journal in recovery.glob(f"*/{JOURNAL}")):
        assert time.monotonic() < end, "nothing is kept"
        time.sleep(0.05)


def test_a_bar_turns_a_lying_scene_and_a_lying_insertion(tmp_path):
    scene = procedural_street()
    still = scene.gaussians.select(np.flatnonzero(scene.nodes == 0))
    for name, gaussians in (
        ("street", still),
        ("car", scene.gaussians.select(np.flatnonzero(scene.instance_ids == FIRST_CAR))),
    ):
        gaussians.means[:] = gaussians.means[:, [0, 2, 1]] * np.float32([1, -1, 1])
        save_scene(tmp_path / f"{name}.ply", scene_from_gaussians(gaussians))
    with editor_window(tmp_path / "street.ply", tmp_path) as window:
        window.click_widget("upright.turn")
        turned = window.wait_for_edit("Turn the scene")["cursor"]
        window.click_widget("upright.flip")
        window.wait_for(lambda state: state["cursor"] == turned + 1, "the other way round")
        window.key("ctrl+z")
        window.wait_for(lambda state: state["cursor"] == turned, "undo")
        window.click_widget("upright.leave")
        window.wait_for(lambda state: "upright.leave" not in state["widgets"], "the bar to go")
        window.key("ctrl+shift+i")
        window.enter_path(tmp_path / "car.ply")
        window.click_widget("upright.turn")
        window.wait_for_edit("Rotate")
        window.click_widget("upright.leave")
        window.wait_for(lambda state: "upright.leave" not in state["widgets"], "the bar to go")
        assert window.quit() == 0
