"""Photo and masks of dataset cameras, the palette, the history and odd splats, through the real window."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from procedural_street import FIRST_CAR, procedural_street
from window_driver import editor_window

from instdrive_core.formats.registry import save_scene
from instdrive_core.masks.label_map_folder import FrameMasks, write_masks

pytestmark = pytest.mark.gui

RED_CAR, BLUE_CAR = FIRST_CAR, FIRST_CAR + 1
RED_CAR_SIDE = (-2.1, 4.6, 0.8)


@pytest.fixture(scope="module")
def filmed_street(tmp_path_factory):
    """The street with photos and masks of its cameras, and with three splats that no street should have."""
    folder = tmp_path_factory.mktemp("street")
    scene, frames, views = procedural_street(), [], []
    rng = np.random.default_rng(1)
    for view in scene.views:
        photo = folder / "clip" / "camera" / view.name / f"{view.index:02d}.png"
        photo.parent.mkdir(parents=True, exist_ok=True)
        size = (view.camera.height, view.camera.width)
        Image.fromarray(rng.integers(0, 255, (*size, 3), np.uint8)).save(photo)
        labels = np.zeros(size, np.uint16)
        labels[: size[0] // 2] = 1
        frames.append((f"{view.name}/{view.index:02d}", FrameMasks(labels, np.zeros(size, bool))))
        views.append(replace(view, photo=str(photo)))
    scene.views = tuple(views)
    write_masks(folder / "clip" / "masks", frames, "exact", 0)
    road = np.flatnonzero(scene.nodes == 0)[:3]
    scene.gaussians.means[road[0]] = np.nan
    scene.gaussians.quats[road[1]] = 0
    scene.gaussians.means[road[2]] = 1e5
    save_scene(folder / "scene", scene)
    return folder / "scene"


@pytest.fixture
def window(filmed_street, tmp_path):
    with editor_window(filmed_street, tmp_path) as driver:
        yield driver


def measure_width(state, name):
    left, _, right, _ = state["widgets"][name]
    return right - left


def test_odd_splats_are_removed_and_the_photo_compared(window):
    window.click_widget("dialog.accept")
    removed = window.wait_for(lambda state: state["history"], "the odd splats to be removed")
    assert removed["history"] == ["Delete 3 splats"]
    window.key("ctrl+z")
    window.wait_for(lambda state: state["cursor"] == 0, "the removal to be undone")

    window.wait_until_calm()
    window.key("p")
    window.wait_for(lambda state: "reference" in state["widgets"], "the photo over the splats")
    left, top, right, bottom = window.wait_for_rect("timeline.reference_opacity")
    window.drag(((left + right) / 2, (top + bottom) / 2), (right - 8, (top + bottom) / 2))
    window.wait_for(lambda state: state["reference"]["opacity"] > 0.8, "the slider to be moved")
    window.key("alt+p")
    beside = window.wait_for(
        lambda state: measure_width(state, "picture") < 0.6 * measure_width(state, "viewport"),
        "the photo beside the splats",
    )
    assert measure_width(beside, "reference") == pytest.approx(measure_width(beside, "picture"), abs=4)
    window.wait_until_calm()
    window.click(*window.pixel_of(RED_CAR_SIDE))
    window.wait_for_selection(RED_CAR)  # clicks hit beside the photo, too
    window.key("shift+p")
    window.wait_for(lambda state: state["reference"]["kind"] == "MASKS", "the masks")
    window.key("Right")
    later = window.wait_for(lambda state: state["time"] > 0, "the next time step")
    assert later["reference"]["kind"] == "MASKS"
    assert not [text for text in window.wait_until_calm()["messages"] if "masks" in text]
    assert window.quit() == 0


def test_palette_history_and_keys(window):
    window.click_widget("dialog.cancel")
    window.wait_until_calm()
    for instance in (RED_CAR, BLUE_CAR):
        window.click_widget(f"instances.{instance}")
        window.wait_for_selection(instance)
        window.key("ctrl+p")
        window.wait_for_widget("palette.search")
        window.type("delet")
        window.tap("Return")
        window.wait_for(lambda state, gone=instance: gone not in state["visible"], "the palette to delete")
    window.key("alt+3")
    window.click_widget("history.2")
    state = window.wait_for(lambda state: state["cursor"] == 2, "the history to jump back")
    assert RED_CAR not in state["visible"]
    assert BLUE_CAR in state["visible"]
    window.click_widget("history.4")
    window.wait_for(lambda state: BLUE_CAR not in state["visible"], "and forwards")
    window.key("F1")
    window.click_widget("dialog.cancel")
    assert window.quit() == 0
