"""Which cameras of the clip are drawn, where the mouse finds them, and the way they were driven along."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from instdrive_app.session.showing.shown_cameras import (
    APEX_PIXELS,
    MOST_MOMENTS,
    build_frustum,
    choose_depth,
    choose_moments,
    choose_present,
    cover_pixel,
    find_drive,
    thin_way,
)
from instdrive_core.scene.camera import Camera, CameraView, look_at


def test_the_present_moment_is_shown_and_the_camera_looked_through_is_not(session, street):
    session.state.show_cameras = True
    views = street.scene.views
    session.navigation.look_through(0)
    assert 0 not in session.cameras.list_shown()
    session.navigation.look_down(())
    session.navigation.set_time(views[4].time)
    assert {views[index].index for index in session.cameras.list_shown()} == {views[4].index}
    assert len(session.cameras.list_shown()) == 2
    session.state.show_all_cameras = True
    assert len(session.cameras.list_shown()) == len(views)
    session.state.show_cameras = False
    assert session.cameras.list_shown() == ()


def test_the_mouse_finds_the_nearest_camera_on_its_frustum_only(session, street):
    session.state.show_cameras = True
    session.navigation.look_down(())
    camera = session.state.viewpoint.fit_camera(1280, 720)
    first = session.cameras.list_shown()[0]
    corners = build_frustum(street.scene.views[first].camera, session.cameras.find_depth())
    middle = camera.project(corners[1:].mean(axis=0)[None])[0][0]
    assert session.cameras.find_at(camera, *middle) == first
    assert session.cameras.find_at(camera, 5.0, 5.0) is None


def test_a_pixel_is_covered_by_what_is_drawn_over_it():
    """Every way round: the convex hull of a frustum's five corners, or the mark at its camera."""
    rng = np.random.default_rng(0)
    eye = Camera(300.0, 300.0, 200.0, 150.0, 400, 300, look_at(np.array([0.0, -6.0, 1.0]), np.zeros(3)))
    places = rng.uniform(-1.5, 1.5, (40, 3))
    frusta = np.array(
        [build_frustum(Camera(90, 90, 50, 40, 100, 80, look_at(place, rng.normal(size=3))), 0.6) for place in places]
    )
    pixels = eye.project(frusta.reshape(-1, 3))[0].reshape(-1, 5, 2)
    for x, y in rng.uniform(0, 1, (60, 2)) * [400, 300]:
        inside = np.array([Delaunay(corners).find_simplex([(x, y)])[0] >= 0 for corners in pixels])
        marked = np.hypot(*(pixels[:, 0] - (x, y)).T) <= APEX_PIXELS
        assert (cover_pixel(frusta, eye, x, y) == (inside | marked)).all()
    behind = frusta + np.array([0.0, -12.0, 0.0])
    assert not cover_pixel(behind, eye, 200.0, 150.0).any()


def test_a_frustum_has_the_corners_of_the_picture():
    lens = Camera(200.0, 210.0, 90.0, 70.0, 200, 140, look_at(np.array([1.0, 2.0, 3.0]), np.array([5.0, 9.0, 1.0])))
    pixels, depths = lens.project(build_frustum(lens, 0.7)[1:])
    assert np.allclose(pixels, [(0, 0), (200, 0), (200, 140), (0, 140)])
    assert np.allclose(depths, 0.7)


def drive(places):
    pose = look_at(np.zeros(3), np.array([1.0, 0.0, 0.0]))
    views = []
    for number, place in enumerate(places):
        own = pose.copy()
        own[:3, 3] = place
        views.append(CameraView(Camera(100, 100, 50, 50, 100, 100, own), "front", number, 0.1 * number))
    return tuple(views)


def test_the_way_is_that_of_a_drive_and_not_of_scattered_photos():
    places = np.stack([np.linspace(0, 80, 300), np.zeros(300), np.full(300, 1.5)], axis=1)
    track = find_drive(drive(places))
    assert track is not None
    way = thin_way(track)
    assert np.allclose(way[[0, -1]], places[[0, -1]])
    assert len(way) < 300
    scattered = np.random.default_rng(1).uniform(-10, 10, (200, 3))
    assert find_drive(drive(scattered)) is None
    assert find_drive(drive(places[:1])) is None


def test_sizes_follow_the_scene_and_many_moments_are_thinned():
    views = drive(np.stack([np.linspace(0, 200, 500), np.zeros(500), np.zeros(500)], axis=1))
    small = tuple(
        replace(view, camera=replace(view.camera, world_from_camera=_shrink(view.camera.world_from_camera)))
        for view in views
    )
    assert choose_depth(views) == pytest.approx(0.6)
    assert choose_depth(small) == pytest.approx(0.04 * 2.0)
    assert 10 < len(choose_moments(views)) <= MOST_MOMENTS
    assert choose_present(views, 12.34) == (123,)
    assert choose_present((), 1.0) == ()


def _shrink(pose):
    small = pose.copy()
    small[:3, 3] /= 100
    return small
