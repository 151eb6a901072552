"""The box: its handles, and selecting, cropping and deleting by it."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR, ROAD

from instdrive_app.session.aids.box_handles import (
    CENTER,
    drag_handle,
    find_handle,
    find_inside,
    locate_handles,
    turn_box,
)
from instdrive_app.session.selection_box import Box
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.selection import Flag

EYE = np.array([3.0, -8.0, 5.0])
CAMERA = Camera(400.0, 400.0, 320.0, 180.0, 640, 360, look_at(EYE, np.zeros(3)))
BOX = Box(np.zeros(3), np.eye(3), np.array([2.0, 3.0, 1.0]))
RED_CAR = Box(np.array([-3.0, 4.0, 0.9]), np.eye(3), np.array([2.4, 5.0, 1.7]))


def test_what_is_inside_follows_the_turned_axes():
    points = np.array([[0, 0, 0], [0.9, 1.4, 0.4], [1.1, 0, 0], [0, 0, 0.6], [1.3, 0, 0]], np.float32)
    assert find_inside(BOX, points).tolist() == [True, True, False, False, False]
    assert find_inside(turn_box(BOX, 90.0), points).tolist() == [True, False, True, False, True]


@pytest.mark.parametrize("name", ["x+", "x-", "y+", "y-", "z+", "z-"])
def test_a_dragged_face_follows_the_pointer_and_the_others_stay(name):
    turned = turn_box(BOX, 20.0)
    axis, side = "xyz".index(name[0]), 1 if name[1] == "+" else -1
    goal = turned.center + side * turned.axes[:, axis] * (turned.size[axis] / 2 + 0.7)
    start, to = locate_handles(turned, CAMERA)[name], tuple(CAMERA.project(goal[None])[0][0].tolist())
    dragged = drag_handle(turned, name, CAMERA, start, to)
    assert dragged.size[axis] == pytest.approx(turned.size[axis] + 0.7, abs=1e-6)
    other = turned.center - side * turned.axes[:, axis] * turned.size[axis] / 2
    assert np.allclose(dragged.center - side * dragged.axes[:, axis] * dragged.size[axis] / 2, other)
    back = drag_handle(turned, name, CAMERA, start, tuple(CAMERA.project((other - goal)[None] * 5)[0][0].tolist()))
    assert (back.size > 0).all()


def test_the_middle_is_dragged_over_the_ground():
    goal = np.array([1.0, -0.5, 0.0])
    start, to = locate_handles(BOX, CAMERA)[CENTER], tuple(CAMERA.project(goal[None])[0][0].tolist())
    assert np.allclose(drag_handle(BOX, CENTER, CAMERA, start, to).center, goal)
    assert find_handle(BOX, CAMERA, start, 10.0) == CENTER
    assert find_handle(BOX, CAMERA, (5.0, 5.0), 10.0) is None
    behind = Box(EYE + np.array([0.0, -50.0, 0.0]), np.eye(3), np.ones(3))
    assert locate_handles(behind, CAMERA) == {}


def inside(session, box):
    means, shown = compute_shown_means(session.document, session.state.time)
    return find_inside(box, means) & shown


def test_it_selects_instances_or_splats(session):
    box = session.aids.box
    assert not session.actions.run("box.select"), "there is no box yet"
    box.box = RED_CAR
    session.actions.run("box.select")
    assert session.selection.ids == (FIRST_CAR,)
    session.state.region_splats = True
    rows = np.flatnonzero(inside(session, RED_CAR))
    session.actions.run("box.select")
    assert np.array_equal(session.document.state.find_rows(Flag.SELECTED), rows)
    session.actions.run("box.deselect")
    assert session.selection.is_empty
    session.actions.run("box.select_outside")
    assert len(session.document.state.find_rows(Flag.SELECTED)) + len(rows) == session.document.state.drawn.sum()
    session.actions.run("box.add")
    assert len(session.document.state.find_rows(Flag.SELECTED)) == session.document.state.drawn.sum()
    session.state.region_splats = False
    box.box = Box(np.array([0.0, 0.0, 90.0]), np.eye(3), np.ones(3))
    session.actions.run("box.select")
    assert session.selection.is_empty
    assert "No instance" in session.messages.log[-1].text


def test_a_crop_follows_the_box_and_every_step_of_it_can_be_undone(session):
    box, state = session.aids.box, session.document.state
    session.visibility.hide((ROAD,))
    shown = state.drawn
    box.box = RED_CAR
    session.actions.run("box.crop")
    cropped = state.drawn
    assert np.array_equal(cropped, inside(session, RED_CAR) & shown)
    assert session.actions["box.crop"].checked()
    larger = Box(RED_CAR.center, RED_CAR.axes, RED_CAR.size * 2.0)
    steps = session.document.history.cursor
    box.begin_drag()
    for size in (1.5, 3.0, 2.0):
        box.change(Box(RED_CAR.center, RED_CAR.axes, RED_CAR.size * size))
    means, _ = compute_shown_means(session.document, 0.0)
    assert np.array_equal(state.drawn, find_inside(larger, means) & shown)
    assert session.document.history.cursor == steps + 1, "one drag is one step"
    session.history.undo()
    assert np.array_equal(state.drawn, cropped)
    session.history.undo()
    assert np.array_equal(state.drawn, shown)
    assert not box.is_cropping
    session.history.redo()
    assert box.is_cropping
    session.actions.run("box.crop")
    assert np.array_equal(state.drawn, shown), "what the user has hidden stays hidden"
    session.actions.run("box.crop")
    session.actions.run("edit.show_all")
    assert not box.is_cropping


def test_what_is_outside_is_deleted_but_what_is_locked(session):
    box, state = session.aids.box, session.document.state
    session.visibility.lock((ROAD,))
    box.box = RED_CAR
    kept = inside(session, RED_CAR) | state.find_mask(Flag.LOCKED)
    session.actions.run("box.crop")
    session.actions.run("box.delete_outside")
    assert np.array_equal(state.drawn, kept)
    assert not box.is_cropping
    assert "spared" in session.messages.log[-1].text
    session.history.undo()
    session.history.undo()
    assert state.drawn.all()
    session.actions.run("box.remove")
    assert box.box is None


def test_removing_the_box_ends_the_crop_and_another_scene_has_none(session, street):
    session.aids.box.box = RED_CAR
    session.actions.run("box.crop")
    session.actions.run("box.remove")
    assert session.document.state.drawn.all()
    session.aids.box.box = RED_CAR
    session.show(street)
    assert session.aids.box.box is None
