"""Moving the viewpoint keeps what it promises to keep."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from procedural_street import procedural_street

from instdrive_app import camera
from instdrive_app.framing import frame_scene
from instdrive_app.state import Intrinsics, Viewpoint, make_default_viewpoint
from instdrive_core.scene.camera import look_at

ANGLES = st.floats(-3, 3)


def somewhere():
    pose = look_at(np.array([1.0, -4.0, 2.0]), np.array([3.0, 5.0, 0.5]))
    return Viewpoint(pose, Intrinsics.from_field_of_view(60.0), 7.0)


def is_rigid(pose):
    return np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9) and np.linalg.det(pose[:3, :3]) > 0


@given(st.lists(st.tuples(ANGLES, ANGLES), max_size=30))
def test_orbiting_keeps_pivot_distance_and_level_horizon(turns):
    viewpoint = start = somewhere()
    for yaw, pitch in turns:
        viewpoint = camera.orbit(viewpoint, yaw, pitch)
    np.testing.assert_allclose(viewpoint.pivot, start.pivot, atol=1e-6)
    assert np.linalg.norm(viewpoint.position - viewpoint.pivot) == pytest.approx(7.0)
    assert is_rigid(viewpoint.world_from_camera)
    assert viewpoint.world_from_camera[2, 0] == pytest.approx(0, abs=1e-6)  # the x axis stays level
    assert viewpoint.world_from_camera[2, 1] <= 1e-6  # and the picture upright


@given(ANGLES, ANGLES)
def test_looking_around_stays_in_place(yaw, pitch):
    turned = camera.look(somewhere(), yaw, pitch)
    np.testing.assert_array_equal(turned.position, somewhere().position)
    assert is_rigid(turned.world_from_camera)


def test_a_drag_to_the_right_turns_the_view_to_the_left_and_back():
    start = somewhere()
    there = camera.orbit(start, 0.3, 0.1)
    np.testing.assert_allclose(camera.orbit(there, -0.3, -0.1).world_from_camera, start.world_from_camera, atol=1e-9)


@given(st.floats(0.2, 5))
def test_dolly_keeps_the_pivot(factor):
    moved = camera.dolly(somewhere(), factor)
    np.testing.assert_allclose(moved.pivot, somewhere().pivot, atol=1e-9)
    assert moved.pivot_distance == pytest.approx(7.0 * factor)


def test_panning_moves_the_pivot_with_the_pointer():
    start = somewhere()
    before = start.fit_camera(800, 600)
    moved = camera.pan_pixels(start, 40, -25, before.fx)
    shown = moved.fit_camera(800, 600).project(start.pivot[None])[0][0]
    np.testing.assert_allclose(shown - before.project(start.pivot[None])[0][0], [40, -25], atol=1e-6)


def test_flying_and_lifting_go_along_the_right_axes():
    start = somewhere()
    ahead = camera.fly(start, np.array([0, 0, 2.0]))
    np.testing.assert_allclose(ahead.position - start.position, 2 * start.forward)
    np.testing.assert_allclose(camera.lift(start, 1.5).position - start.position, [0, 0, 1.5])


@given(st.tuples(*[st.floats(-50, 50)] * 3), st.tuples(*[st.floats(0.1, 30)] * 3))
def test_a_framed_box_is_wholly_in_view(corner, extent):
    low = np.array(corner)
    high = low + np.array(extent)
    viewpoint = camera.frame_box(somewhere(), low, high)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    pixels, depths = viewpoint.fit_camera(640, 480).project(corners)
    assert (depths > 0).all()
    assert (pixels >= 0).all()
    assert (pixels <= [640, 480]).all()


def test_a_dataset_camera_is_shown_whole_whatever_the_viewport():
    view = procedural_street(0.5).views[0]
    viewpoint = camera.view_from_camera(view)
    same = viewpoint.fit_camera(480, 270)
    assert (same.fx, same.fy, same.cx, same.cy) == (400, 400, 240, 135)
    for size in ((900, 300), (300, 900)):
        fitted, (left, top, right, bottom) = viewpoint.fit_camera(*size), viewpoint.fit_film(*size)
        corner = view.camera.world_from_camera[:3, :3] @ [-240 / 400, -135 / 400, 1] + view.camera.position
        np.testing.assert_allclose(fitted.project(corner[None])[0][0], [left, top], atol=1e-9)
        assert right - left <= size[0]
        assert bottom - top <= size[1]
        assert (right - left) / (bottom - top) == pytest.approx(480 / 270)


@pytest.mark.parametrize("turns", [0, 1, 3])
def test_a_birds_eye_sees_most_of_the_scene_with_the_heading_up(turns):
    means = procedural_street(0.5).gaussians.means
    before = camera.orbit(frame_scene(means), 0.7 * turns, 0.0)
    above = camera.look_straight_down(before, means)
    pixels, depths = above.fit_camera(640, 360).project(means)
    assert (depths > 0).mean() > 0.97
    assert ((pixels >= 0) & (pixels <= [640, 360])).all(axis=1).mean() > 0.93
    np.testing.assert_allclose(above.world_from_camera[:3, :3] @ [0, 0, 1], [0, 0, -1], atol=1e-12)
    up = -above.world_from_camera[:3, 1]
    assert up @ before.forward > 0.5
    again = camera.look_straight_down(above, means)
    np.testing.assert_allclose(again.world_from_camera, above.world_from_camera, atol=1e-6)
    turn = above.world_from_camera[:3, :3]
    np.testing.assert_allclose(np.linalg.det(turn), 1)


def test_an_overview_looks_at_the_scene_and_an_empty_scene_has_one_too():
    means = procedural_street(0.5).gaussians.means
    _, depths = frame_scene(means).fit_camera(640, 360).project(means)
    assert (depths > 0).mean() > 0.95
    np.testing.assert_array_equal(frame_scene(means[:0]).world_from_camera, make_default_viewpoint().world_from_camera)
