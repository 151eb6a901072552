"""Rectangle and lasso in the real window, with true mouse events; growing, shrinking, inverting, deleting splats."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR, ROAD, procedural_street

pytestmark = pytest.mark.gui

RED_CAR, BLUE_CAR = FIRST_CAR, FIRST_CAR + 1
RED_BOX = ((-4.0, 1.7, 0.0), (-2.0, 6.3, 1.6))
BLUE_BOX = ((2.0, 5.7, 0.0), (4.0, 10.3, 1.6))
"""Opposite corners, in the world, of boxes around the cars."""
RED_CAR_SIDE = (-2.1, 4.6, 0.8)


@pytest.fixture(scope="module")
def scene():
    return procedural_street()


def outline(window, box):
    """Left, top, right, bottom, in the window, of a world box."""
    (x0, y0, z0), (x1, y1, z1) = box
    corners = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]
    pixels = window.pixels_of(corners)
    left, top, right, bottom = window.state["widgets"]["viewport"]
    low = np.maximum(pixels.min(axis=0), [left + 60, top + 60])
    return (*low, *np.minimum(pixels.max(axis=0), [right - 4, bottom - 4]))


def rectangle(window, box, *modifiers):
    """Drag from corner to corner."""
    left, top, right, bottom = outline(window, box)
    window.drag((left, top), (right, bottom), modifiers=modifiers)


def lasso(window, box, *modifiers):
    """Drag along the ellipse around a box."""
    left, top, right, bottom = outline(window, box)
    angles = np.linspace(0, 2 * np.pi, 24)
    middle, radius = ((left + right) / 2, (top + bottom) / 2), ((right - left) * 0.62, (bottom - top) * 0.62)
    path = np.stack([middle[0] + radius[0] * np.cos(angles), middle[1] + radius[1] * np.sin(angles)], axis=1)
    window.drag_along([tuple(point) for point in path], modifiers=modifiers)


@pytest.mark.slow
def test_rectangle_lasso_and_their_keys(window):
    start = window.state["camera"]["world_from_camera"]
    window.key("b")
    window.wait_for(lambda state: state["tool"] == "rectangle", "B to take the rectangle")
    rectangle(window, RED_BOX)
    state = window.wait_for(lambda state: RED_CAR in state["selected"], "the rectangle to select the red car")
    assert ROAD not in state["selected"]
    assert state["camera"]["world_from_camera"] == start, "the drag moved the camera"
    window.click_widget("tool.lasso")
    window.wait_for(lambda state: state["tool"] == "lasso", "the toolbar to give the lasso")
    lasso(window, BLUE_BOX, "shift")
    window.wait_for(lambda state: {RED_CAR, BLUE_CAR} <= set(state["selected"]), "Shift to add the blue car")
    find_rectangle_of_red(window, "ctrl")
    window.wait_for(lambda state: RED_CAR not in state["selected"], "Ctrl to remove the red car")
    assert BLUE_CAR in window.state["selected"]
    window.key("ctrl+a")
    window.wait_for(lambda state: len(state["selected"]) > 10, "everything to be selected")
    find_rectangle_of_red(window, "ctrl", "shift")
    state = window.wait_for(lambda state: len(state["selected"]) < 4, "both keys to keep what is inside")
    assert RED_CAR in state["selected"]
    drag_and_escape(window)
    window.click(*window.pixel_of(RED_CAR_SIDE))
    picked = window.wait_for_selection(RED_CAR)
    left, top, right, bottom = outline(window, BLUE_BOX)
    window.drag((left, top), (right, bottom), button=3)
    turned = window.wait_for(lambda state: state["camera"] != picked["camera"], "the right drag to turn the camera")
    assert turned["cursor"] == picked["cursor"], "the right drag selects nothing"
    assert window.quit() == 0


def find_rectangle_of_red(window, *modifiers):
    window.key("b")
    window.wait_for(lambda state: state["tool"] == "rectangle", "B to take the rectangle")
    rectangle(window, RED_BOX, *modifiers)


def drag_and_escape(window):
    """Escape ends the drag, not the selection."""
    before = window.wait_until_calm()
    left, top, right, bottom = outline(window, BLUE_BOX)
    window.drag((left, top), (right, bottom), before_release=lambda: window.key("Escape"))
    after = window.wait_until_calm()
    for name in ("selected", "cursor"):
        assert after[name] == before[name]


def test_splats_grow_shrink_invert_delete_and_undo(window, scene):
    window.key("b")
    window.click_widget("tool.single_splats")
    window.click_widget("tool.visible_only")
    left, top, right, bottom = outline(window, RED_BOX)
    window.drag(((left + right) / 2, top), (right, bottom))
    half = window.wait_for(lambda state: state["selected_splats"] > 0, "splats to be selected")
    assert RED_CAR in half["selected"]
    members = int((scene.instance_ids == RED_CAR).sum())
    window.key("ctrl+equal")
    grown = window.wait_for(lambda state: state["history"][-1] == "Grow selection", "the selection to grow")
    assert grown["selected_splats"] > half["selected_splats"]
    window.click_widget("menu Select")
    window.click_widget("menu select.shrink")
    shrunk = window.wait_for(lambda state: state["history"][-1] == "Shrink selection", "the selection to shrink")
    assert shrunk["selected_splats"] < grown["selected_splats"]
    window.key("Delete")
    gone = window.wait_for(lambda state: state["history"][-1] == "Delete selection", "the splats to be deleted")
    assert gone["selected_splats"] == 0
    assert RED_CAR in gone["visible"], "only some of the car's splats are gone"
    window.key("ctrl+z")
    back = window.wait_for(lambda state: state["cursor"] == shrunk["cursor"], "undo")
    assert back["selected_splats"] == shrunk["selected_splats"]
    window.click_widget("tool.pick")
    window.click(*window.pixel_of(RED_CAR_SIDE))
    window.wait_for(lambda state: state["selected_splats"] == members, "the whole car")
    window.key("ctrl+i")
    window.wait_for(lambda state: state["selected_splats"] == len(scene) - members, "all but the car")
    window.key("ctrl+i")
    window.wait_for(lambda state: state["selected_splats"] == members, "the car again")
    window.key("k")
    cars = {instance.id for instance in scene.table if instance.class_name == "Car"}
    window.wait_for(lambda state: set(state["selected"]) == cars, "all cars")
    assert window.quit() == 0
