"""Moving, turning and copying cars in the real window, by handles and by typed numbers."""

import time

import numpy as np
import pytest
from plyfile import PlyData
from procedural_street import DRIVING_CAR, FIRST_CAR, driving_track, procedural_street

from instdrive_app.session.selection_box import SelectionBoxes
from instdrive_core.edits.document.document import Document

pytestmark = pytest.mark.gui

BLUE_CAR, BLUE_CAR_REAR, DRIVING_CAR_REAR = FIRST_CAR + 1, (3.4, 5.8, 0.8), (0.8, 6.8, 0.8)
"""World points on cars that the first camera sees."""


def take(window, point, instance, key):
    window.click(*window.pixel_of(point))
    window.wait_for_selection(instance)
    window.key(key)
    return window.wait_for_widget("gizmo.center")


def drag_handle(window, name, by, *modifiers):
    """Drag a handle by (x, y) pixels; the state after it."""
    x, y = window.wait_for_widget(f"gizmo.{name}")
    steps = len(window.state["history"])
    window.move(x, y)
    time.sleep(0.2)
    window.drag((x, y), (x + by[0], y + by[1]), modifiers=modifiers)
    window.wait_for(lambda state: len(state["history"]) == steps + 1, f"one step by the handle {name}")
    return window.wait_until_calm()


def type_into(window, field, text):
    window.click_widget(f"inspector.{field}", "ctrl")
    time.sleep(0.2)
    window.key("ctrl+a")
    window.type(text)
    steps = window.state["cursor"]
    window.tap("Return")
    window.wait_for(lambda state: state["cursor"] == steps + 1, f"{field} to be applied in one step")


def export_scene(window, path):
    """The exported splats, by an independent reader."""
    window.export(path)
    return PlyData.read(path)["vertex"].data


def read_points(vertices, instance):
    part = vertices[vertices["instance_id"] == instance]
    if "synthetic" in part.dtype.names:  # the shadow that was laid where it stands
        part = part[part["synthetic"] != 2]
    return np.stack([part["x"], part["y"], part["z"]], axis=1).astype(float)


def turn_between(before, after):
    """The rotation that takes one set of points to the other one best (Kabsch), and by how much it misses (metres)."""
    a, b = before - before.mean(axis=0), after - after.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    rotation = (u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt).T
    return rotation, np.abs(a @ rotation.T - b).max()


def test_a_car_is_moved_and_turned_by_handles(window, tmp_path):
    scene = procedural_street()
    before = scene.gaussians.means[scene.instance_ids == BLUE_CAR].astype(float)
    start = take(window, BLUE_CAR_REAR, BLUE_CAR, "t")
    state = drag_handle(window, "x", (-90, 0), "ctrl")
    assert state["history"][-1] == f"Move instance {BLUE_CAR}"
    assert state["selected"] == [BLUE_CAR], "a drag of a handle is no click"
    center = window.wait_for_widget("gizmo.center")
    assert center[0] - start[0] == pytest.approx(-90, abs=20)
    window.key("r")
    x, y = window.wait_for_widget("gizmo.z")
    window.move(x, y)
    time.sleep(0.2)

    def escape():
        window.wait_for(lambda state: len(state["history"]) == 3, "the car to turn while the handle is held")
        window.key("Escape")

    window.drag((x, y), (x - 60, y), before_release=escape)
    state = window.wait_until_calm()
    assert len(state["history"]) == 2, "Escape gives the drag up"
    assert state["selected"] == [BLUE_CAR], "and nothing else"
    state = drag_handle(window, "z", (60, 0))
    camera = state["camera"]["world_from_camera"]
    assert np.allclose(camera, scene.views[0].camera.world_from_camera), "handles do not turn the camera"
    vertices = export_scene(window, tmp_path / "moved.ply")
    after = read_points(vertices, BLUE_CAR)
    turn, miss = turn_between(before, after)
    assert miss < 1e-3, "the car stays the same car"
    np.testing.assert_allclose(turn[2], [0, 0, 1], atol=1e-5)
    assert np.degrees(np.arctan2(turn[1, 0], turn[0, 0])) > 10, "the near side was dragged to the right"
    pivot = SelectionBoxes().find_box(Document(scene), (BLUE_CAR,), 0.0).center
    shift = after.mean(axis=0) - (turn @ (before.mean(axis=0) - pivot) + pivot)
    assert shift[0] < -0.8
    np.testing.assert_allclose(shift[1:], 0, atol=0.05, err_msg="only along the handle's axis")
    steps = np.linalg.norm(shift) / 0.25
    assert steps == pytest.approx(round(steps), abs=0.01), "Ctrl snaps to quarters of a metre"
    others = vertices[(vertices["instance_id"] != BLUE_CAR) & (vertices["instance_id"] != DRIVING_CAR)]
    kept = scene.gaussians.means[~np.isin(scene.instance_ids, (BLUE_CAR, DRIVING_CAR))]
    np.testing.assert_array_equal(others["x"], kept[:, 0])
    rear = after[after[:, 1] < np.quantile(after[:, 1], 0.1)].mean(axis=0)
    window.move(*window.pixel_of(rear))
    window.wait_for(lambda state: state["hovered"] == BLUE_CAR, "the car to be found where it is now")


def test_a_handle_is_grasped_also_by_a_press_that_comes_with_the_mouse(window):
    """In the frame that first sees the mouse there: it came over the picture, or from outside of the view."""
    take(window, BLUE_CAR_REAR, BLUE_CAR, "t")
    steps = len(window.state["history"])
    for count, (start, beside) in enumerate((("gizmo.center", 160), ("instances.search", 0))):
        x, y = window.wait_for_widget(start)
        window.move(x - beside, y)
        window.wait_for_frames()
        x, y = window.wait_for_widget("gizmo.x")
        camera = window.state["camera"]
        window.hasty_drag((x, y), (x + 40, y))
        state = window.wait_for(
            lambda state, past=steps + count: len(state["history"]) > past, "the drag to move the car"
        )
        assert state["history"][-1].startswith("Move")
        assert state["camera"] == camera, "the camera stays where it is"
    assert window.quit() == 0


def test_typed_numbers_undo_and_a_copy(window):
    take(window, BLUE_CAR_REAR, BLUE_CAR, "t")
    before = window.wait_for_widget("gizmo.center")
    type_into(window, "x", "1.5")
    window.wait_until_calm()
    assert window.wait_for_widget("gizmo.center")[0] < before[0] - 50
    type_into(window, "yaw", "40")
    window.key("ctrl+z")
    window.key("ctrl+z")
    window.wait_for(lambda state: state["cursor"] == 1, "both numbers to be undone")
    window.wait_until_calm()
    assert window.wait_for_widget("gizmo.center") == before
    window.key("ctrl+d")
    state = window.wait_for(lambda state: state["history"][-1].startswith("Duplicate"), "the copy")
    (copy,) = state["selected"]
    assert copy not in procedural_street().table
    assert copy in state["visible"]
    window.wait_until_calm()
    assert window.wait_for_widget("gizmo.center") != before
    window.key("ctrl+z")
    window.wait_for(lambda state: state["selected"] == [BLUE_CAR] and copy not in state["visible"], "undo")


def test_of_a_driving_car_the_whole_track_is_moved(window):
    take(window, DRIVING_CAR_REAR, DRIVING_CAR, "t")
    track = driving_track()
    for field, value in (("x", "0.5"), ("z", "2")):
        type_into(window, field, value)
    for now in (0.0, 0.5):
        place = track.interpolate_pose(now)[:3, 3]
        expected = window.pixel_of((0.5, place[1], 2.0))
        assert window.wait_for_widget("gizmo.center") == pytest.approx(expected, abs=1.0)
        window.key("Right")
        window.wait_for(lambda state, now=now: state["time"] > now, "the next time step")
    window.key("ctrl+z")
    window.key("ctrl+z")
    window.wait_for(lambda state: state["cursor"] == 1, "undo")
    expected = window.pixel_of(track.interpolate_pose(1.0)[:3, 3])
    assert window.wait_for_widget("gizmo.center") == pytest.approx(expected, abs=1.0)
