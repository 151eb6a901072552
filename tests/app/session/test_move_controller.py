"""Moving, without a window: drags, numbers, copies, and the box that goes along."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR
from session_driver import errors, finish

from instdrive_app.panels.overlays.gizmo import (
    choose_gizmo_axes,
    compute_gl_projection,
    compute_gl_view,
    extract_change,
)
from instdrive_app.session import move_controller
from instdrive_app.session.selection_box import BOX_EDGES
from instdrive_app.state import Intrinsics
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteRows
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.visibility import LockInstances
from instdrive_core.edits.queries.bake import bake_document, freeze_at_time
from instdrive_core.edits.queries.placement import compute_bottom, compute_center
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.rasterize.kernels.view_colors import compute_colors
from instdrive_core.rasterize.preview import render_preview
from instdrive_core.scene.camera import Camera, look_at

TREE = 30
LENS = Intrinsics(500.0, 500.0, 320.0, 180.0, 640, 360)
NO_TURN = np.eye(3)


@pytest.fixture
def session(session):
    """With a car selected."""
    session.selection.select((FIRST_CAR,))
    return session


def yaw(degrees):
    return matrix_from_quaternion(np.array([np.cos(np.radians(degrees / 2)), 0, 0, np.sin(np.radians(degrees / 2))]))


def middle(session, instance=FIRST_CAR):
    return compute_center(session.document, (instance,), session.state.time)


# Drags


def test_a_drag_is_one_step_told_from_where_it_began(session, street):
    moving, steps, start = session.movement, street.history.cursor, session.movement.find_center()
    means = street.compute_means(street.find_rows((FIRST_CAR,)))
    moving.begin_drag(np.eye(3))
    for part in np.linspace(0, 1, 200):
        moving.drag_to(np.array([3 * part, part, 0.0]), yaw(40 * part), 1 + part)
    moving.end_drag()
    assert street.history.cursor == steps + 1
    arrived = start + np.array([3, 1, 0])
    np.testing.assert_allclose(moving.find_center(), arrived, atol=1e-9)
    expected = 2 * (means - start) @ yaw(40).T + arrived
    np.testing.assert_allclose(street.compute_means(street.find_rows((FIRST_CAR,))), expected, atol=2e-5)
    assert len(street.transforms) == 2, "200 frames leave one entry"
    session.history.undo()
    np.testing.assert_array_equal(street.compute_means(street.find_rows((FIRST_CAR,))), means)


def test_a_drag_back_to_its_start_is_no_step_and_goes_on_from_there(session, street):
    steps = street.history.cursor
    session.movement.begin_drag(np.eye(3))
    for x in (1.0, 0.0):
        session.movement.drag_to(np.array([x, 0.0, 0.0]), NO_TURN, 1.0)
    assert street.history.cursor == steps
    session.movement.drag_to(np.array([2.0, 0.0, 0.0]), NO_TURN, 1.0)
    session.movement.drag_to(np.array([3.0, 0.0, 0.0]), NO_TURN, 1.0)
    assert street.history.cursor == steps + 1


def test_a_drag_that_is_given_up_leaves_nothing(session, street):
    edits, start = street.history.edits, street.compute_means(street.find_rows((FIRST_CAR,)))
    session.movement.options.on_ground = True
    session.movement.begin_drag(np.eye(3))
    session.movement.drag_to(np.array([1.0, 2.0, 0.0]), yaw(20), 1.1)
    session.movement.cancel_drag()
    assert street.history.edits == edits
    np.testing.assert_array_equal(street.compute_means(street.find_rows((FIRST_CAR,))), start)
    session.movement.begin_drag(np.eye(3))
    session.movement.cancel_drag()
    assert street.history.edits == edits


def test_what_hinders_a_drag_is_told_once_and_the_last_good_place_stays(session, street):
    session.movement.options.on_ground = True
    session.movement.begin_drag(np.eye(3))
    session.movement.drag_to(np.array([1.0, 0.0, 0.0]), NO_TURN, 1.0)
    good = middle(session)
    for x in (300.0, 301.0, 302.0):
        session.movement.drag_to(np.array([x, 0.0, 0.0]), NO_TURN, 1.0)
    assert len(errors(session)) == 1
    assert "no ground" in errors(session)[0]
    np.testing.assert_array_equal(middle(session), good)
    session.movement.drag_to(np.array([2.0, 0.0, 0.0]), NO_TURN, 1.0)
    assert middle(session)[0] == pytest.approx(good[0] + 1, abs=0.02)


def test_a_drag_ends_with_its_selection(session, street):
    session.movement.begin_drag(np.eye(3))
    street.apply(DeleteInstances((FIRST_CAR,)))
    steps = street.history.cursor
    session.movement.drag_to(np.array([1.0, 0.0, 0.0]), NO_TURN, 1.0)
    assert session.movement.drag is None
    assert (street.history.cursor, errors(session)) == (steps, [])


def test_along_the_lane_only_the_lane_counts(session, street):
    session.movement.options.along_lane = True
    lane, start = session.movement.find_lane(), middle(session)
    np.testing.assert_allclose(np.abs(lane), [0, 1, 0], atol=0.1)
    session.movement.begin_drag(choose_gizmo_axes(session.movement, session.movement.find_box(), "move"))
    session.movement.drag_to(np.array([5.0, 4.0, 2.0]), NO_TURN, 1.0)
    np.testing.assert_allclose(middle(session) - start, lane * (lane @ [5, 4, 2]), atol=0.02)


def test_vehicles_turn_upright_others_freely_until_the_user_says_so(session):
    moving = session.movement
    assert moving.yaw_only
    session.selection.select((FIRST_CAR, DRIVING_CAR))
    assert moving.yaw_only
    session.selection.select((FIRST_CAR, TREE))
    assert not moving.yaw_only
    session.actions.run("move.yaw_only")
    assert moving.yaw_only
    session.selection.select((FIRST_CAR,))
    session.actions.run("move.yaw_only")
    assert not moving.yaw_only


def preview_of(scene, camera, harmonics=None):
    """The car alone, by the renderer of windows without a GPU."""
    gaussians = scene.gaussians.select(np.flatnonzero(scene.instance_ids == FIRST_CAR))
    rest = gaussians.sh_rest if harmonics is None else harmonics
    nodes = np.zeros(len(gaussians), np.uint16)
    colors = compute_colors(gaussians.means, gaussians.sh_dc, rest, camera.position, nodes, np.eye(4)[None])
    shape = (gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacities)
    return render_preview(*shape, colors, camera).color


def test_the_dragged_car_seen_from_the_same_side_looks_the_same(session, street):
    rows = street.find_rows((FIRST_CAR,))
    rest = street.scene.gaussians.sh_rest
    rest[rows] = np.random.default_rng(8).normal(0, 0.3, rest[rows].shape)
    moving, pivot = session.movement, session.movement.find_center()
    pose = look_at(pivot + np.array([-4.0, -5.0, 2.0]), pivot)
    camera = Camera(150.0, 150.0, 80.0, 60.0, 160, 120, pose)
    before = preview_of(street.scene, camera)
    moving.begin_drag(np.eye(3))
    for part in np.linspace(0, 1, 12):
        moving.drag_to(np.array([4.0, 2.0, 0.0]) * part, yaw(110 * part), 1 + 0.4 * part)
    moving.end_drag()
    along = pose.copy()
    along[:3, :3] = yaw(110) @ pose[:3, :3]
    along[:3, 3] = 1.4 * yaw(110) @ (pose[:3, 3] - pivot) + pivot + [4, 2, 0]
    camera_along = replace(camera, world_from_camera=along)
    after = bake_document(street)
    np.testing.assert_allclose(preview_of(after, camera_along), before, atol=5e-3)
    unturned = np.abs(preview_of(after, camera_along, rest[rows]) - before).max()
    assert unturned > 0.1, "the view-dependent colour has to turn"


# Numbers


def test_numbers_say_where_things_are_and_bring_them_there(session, street):
    moving = session.movement
    before = moving.find_placement()
    assert (before.yaw, before.scale) == (0.0, 1.0)
    for field, value in (("position", (-2.0, 5.0, 1.5)), ("yaw", 30.0), ("scale", 1.5)):
        present = moving.find_placement()
        moving.place(present, type(present)(**{**vars(present), field: value}))
    after = moving.find_placement()
    np.testing.assert_allclose(after.position, (-2, 5, 1.5), atol=0.06)
    assert after.yaw == pytest.approx(30)
    assert after.scale == pytest.approx(1.5)
    session.actions.run("move.reset")
    assert moving.find_placement() == before


def test_a_typed_height_is_not_drawn_to_the_ground_but_a_typed_place_is(session, street):
    moving = session.movement
    moving.options.on_ground = True
    present = moving.find_placement()
    x, y, z = present.position
    moving.place(present, type(present)((x, y, z + 3), present.yaw, present.scale))
    assert moving.find_center()[2] == pytest.approx(z + 3, abs=1e-9)
    present = moving.find_placement()
    moving.place(present, type(present)((x + 1, *present.position[1:]), present.yaw, present.scale))
    assert compute_bottom(street, (FIRST_CAR,), np.eye(3, 4), 0.0) == pytest.approx(0.0, abs=0.1)


def test_strays_below_a_car_are_not_what_it_stands_on(session, street):
    rows = np.flatnonzero(street.scene.instance_ids == FIRST_CAR)[::20]
    before = compute_bottom(street, (FIRST_CAR,), np.eye(3, 4), 0.0)
    street.scene.gaussians.means[rows, 2] -= np.linspace(1, 9, len(rows), dtype=np.float32)
    assert compute_bottom(street, (FIRST_CAR,), np.eye(3, 4), 0.0) == pytest.approx(before, abs=0.1)


def test_put_on_the_ground_and_along_the_lane_by_metres(session, street):
    session.movement.begin_drag(np.eye(3))
    session.movement.drag_to(np.array([0.0, 0.0, 4.0]), NO_TURN, 1.0)
    session.movement.end_drag()
    assert session.actions.run("move.put_on_ground")
    assert compute_bottom(street, (FIRST_CAR,), np.eye(3, 4), 0.0) == pytest.approx(0.0, abs=0.1)
    start, steps = middle(session), street.history.cursor
    for metres in (1.0, 5.0):
        session.movement.shift_along_lane(metres, "typed")
    np.testing.assert_allclose(np.linalg.norm(middle(session) - start), 5, atol=0.01)
    assert street.history.cursor == steps + 1


def test_several_things_are_put_on_the_ground_each_by_itself(session, street):
    cars = (FIRST_CAR, FIRST_CAR + 1)
    before = [compute_bottom(street, (car,), np.eye(3, 4), 0.0) for car in cars]
    for car, lift in zip(cars, (1.0, 3.0), strict=True):
        street.apply(MoveInstances((car,), translation=(0.0, 0.0, lift)))
    session.selection.select(cars)
    steps = street.history.cursor
    session.movement.put_on_ground()
    after = [compute_bottom(street, (car,), np.eye(3, 4), 0.0) for car in cars]
    np.testing.assert_allclose(after, before, atol=0.15)
    assert street.history.cursor == steps + 1


def test_of_what_drives_the_track_is_edited_at_the_shown_moment(session, street):
    session.selection.select((DRIVING_CAR,))
    session.navigation.look_from(session.state.viewpoint)
    session.navigation.set_time(1.0)
    session.movement.options.body_only = False
    track, present = street.scene.actors[0], session.movement.find_placement()
    np.testing.assert_allclose(present.position, track.interpolate_pose(1.0)[:3, 3])
    session.movement.place(present, type(present)(present.position, 90.0, 1.0))
    turned = street.scene.actors[0]
    np.testing.assert_allclose(turned.interpolate_pose(1.0)[:3, 3], track.interpolate_pose(1.0)[:3, 3], atol=1e-9)
    before, after = (one.interpolate_pose(2.0)[:3, 3] - one.interpolate_pose(1.0)[:3, 3] for one in (track, turned))
    np.testing.assert_allclose(after, yaw(90) @ before, atol=1e-9)
    assert session.movement.find_placement().yaw == pytest.approx(90)
    session.actions.run("move.reset")
    assert street.scene.actors[0] is track


# The box


def test_the_box_fits_the_car_and_goes_along(session, street):
    moving = session.movement
    box = moving.find_box()
    np.testing.assert_allclose(box.size, [1.85, 4.4, 1.5], atol=0.2)
    np.testing.assert_allclose(box.upright_axes, np.eye(3), atol=0.05)
    moving.begin_drag(box.upright_axes)
    moving.drag_to(np.array([1.0, 2.0, 0.0]), yaw(30), 1.2)
    moving.end_drag()
    free = moving.find_box()
    np.testing.assert_allclose(free.center, box.center + np.array([1, 2, 0]), atol=1e-9)
    np.testing.assert_allclose(free.axes, yaw(30) @ box.axes, atol=1e-6)
    np.testing.assert_allclose(free.size, 1.2 * box.size)
    session.selection.select((DRIVING_CAR,))
    np.testing.assert_allclose(moving.find_box().size, street.scene.actors[0].dimensions)
    session.selection.select((FIRST_CAR, DRIVING_CAR))
    corners = moving.find_box().corners
    for inner in (free.center, street.scene.actors[0].interpolate_pose(0.0)[:3, 3]):
        assert (corners.min(axis=0) < inner).all()
        assert (corners.max(axis=0) > inner).all()


def test_four_quarter_turns_by_typed_numbers_lead_back(session, street):
    rows = street.find_rows((FIRST_CAR,))
    before, moving = street.compute_means(rows), session.movement
    for degrees in (90.0, 180.0, -90.0, 0.0):
        present = moving.find_placement()
        moving.place(present, type(present)(present.position, degrees, 1.0))
        assert moving.find_placement().position == pytest.approx(present.position, abs=1e-9)
    np.testing.assert_allclose(street.compute_means(rows), before, atol=2e-6)


def test_the_box_is_measured_anew_where_splats_leave(session, street):
    whole = session.movement.find_box()
    rows = street.find_rows((FIRST_CAR,))
    front = rows[street.compute_means(rows)[:, 1] > whole.center[1]]
    street.apply(DeleteRows(front))
    assert session.movement.find_box().size[1] < 0.6 * whole.size[1]


def test_box_edges_are_the_twelve_of_a_box(session):
    box = session.movement.find_box()
    lengths = [np.linalg.norm(box.corners[a] - box.corners[b]) for a, b in BOX_EDGES]
    np.testing.assert_allclose(sorted(lengths), sorted(np.repeat(box.size, 4)))


# What ImGuizmo is told


def test_gizmos_are_seen_as_the_camera_sees():
    camera = Camera(410.0, 395.0, 300.0, 180.0, 640, 400, look_at(np.array([3.0, -8, 2]), np.zeros(3)))
    points = np.random.default_rng(5).uniform(-2, 2, (50, 3))
    clip = np.c_[points, np.ones(50)] @ (compute_gl_projection(camera) @ compute_gl_view(camera)).T
    ndc = clip[:, :3] / clip[:, 3:]
    pixels = (ndc[:, :2] * [0.5, -0.5] + 0.5) * [640, 400]
    np.testing.assert_allclose(pixels, camera.project(points)[0], atol=1e-9)
    assert (np.abs(ndc[:, 2]) < 1).all()


def test_what_a_gizmo_did_is_read_from_its_matrix():
    axes = yaw(25)
    matrix = np.eye(4)
    matrix[:3, :3] = yaw(70) @ axes * [1.0, 1.5, 0.98]
    matrix[:3, 3] = (1, 2, 3)
    shift, rotation, scale = extract_change(matrix, axes)
    np.testing.assert_array_equal(shift, [1, 2, 3])
    np.testing.assert_allclose(rotation, yaw(70), atol=1e-12)
    assert scale == pytest.approx(1.5)


# Copies


def test_many_splats_are_copied_beside_the_window(session, street, monkeypatch):
    monkeypatch.setattr(move_controller, "COPIED_AT_ONCE", 1000)
    steps = street.history.cursor
    assert session.actions.run("move.duplicate")
    assert street.history.cursor == steps, "the copy is not there yet"
    session.history.apply(DeleteInstances((FIRST_CAR,)))
    assert street.history.cursor == steps, "edits wait for it"
    finish(session)
    (copy,) = session.selection.ids
    assert street.scene.table[copy].count == street.scene.table[FIRST_CAR].count
    assert (street.history.cursor, session.state.tool) == (steps + 1, "move")


def test_a_copy_stands_beside_its_original_selected_and_in_hand(session, street):
    before, steps = freeze_at_time(bake_document(street), 0.0), street.history.cursor
    assert session.actions.run("move.duplicate")
    (copy,) = session.selection.ids
    assert copy not in before.table
    assert session.state.tool == "move"
    apart = middle(session, copy) - middle(session)
    lane = session.movement.find_lane()
    np.testing.assert_allclose(apart, lane * np.linalg.norm(apart), atol=1e-5)
    assert 4.4 < np.linalg.norm(apart) < 6
    assert street.history.cursor == steps + 1
    session.history.undo()
    assert copy not in street.scene.table
    assert session.selection.ids == (FIRST_CAR,)
    session.history.redo()
    assert session.selection.ids == (copy,)


def test_locked_things_stay_and_say_so(session, street):
    start = middle(session)
    street.apply(LockInstances((FIRST_CAR,)))
    session.selection.select((FIRST_CAR,))
    session.movement.put_on_ground()
    assert session.selection.ids == () or "unlock" in errors(session)[-1]
    np.testing.assert_array_equal(middle(session), start)


# What drives


@pytest.mark.parametrize("body_only", [True, False])
def test_turning_what_drives_leaves_its_drive_unless_wanted(session, street, body_only):
    """Here, either way the body turns by 90°; only with its drive does the path turn, too."""
    moving = session.movement
    assert not moving.has_drive
    session.selection.select((DRIVING_CAR,))
    (path,) = moving.find_paths()
    before = street.scene.actors[0]
    moving.options.body_only = body_only
    moving.begin_drag(np.eye(3))
    moving.drag_to(np.zeros(3), yaw(90), 1.0)
    moving.end_drag()
    after = street.scene.actors[0]
    here, there = (track.interpolate_pose(session.state.time) for track in (before, after))
    np.testing.assert_allclose(there[:3, :3], yaw(90) @ here[:3, :3], atol=1e-9)
    np.testing.assert_allclose(there[:3, 3], here[:3, 3], atol=0.2)
    way, new_way = path[-1] - path[0], moving.find_paths()[0][-1] - moving.find_paths()[0][0]
    np.testing.assert_allclose(new_way, way if body_only else yaw(90) @ way, atol=1e-9)
    session.history.undo()
    np.testing.assert_array_equal(street.scene.actors[0].world_from_box, before.world_from_box)
