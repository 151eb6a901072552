"""Things are framed from where photos show them: seen from elsewhere, a drive is noise."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import driving_track

from instdrive_app.camera import dolly, find_main_box, look
from instdrive_app.framing import MOST_ZOOM, frame_thing
from instdrive_app.sights import find_overview, find_sights
from instdrive_app.state import make_default_viewpoint
from instdrive_core.scene.camera import Camera, CameraView, look_at

NOTHING = np.zeros((0, 3)), np.zeros(0)


def drive_along(count=5):
    """Photos that look ahead, each two metres farther along y."""
    poses = [look_at(np.array([0.0, 2.0 * k, 1.5]), np.array([0.0, 2.0 * k + 10, 1.5])) for k in range(count)]
    cameras = [Camera(400.0, 400.0, 240.0, 135.0, 480, 270, pose) for pose in poses]
    return tuple(CameraView(camera, "front", k, 0.5 * k) for k, camera in enumerate(cameras))


def make_car(y):
    rng = np.random.default_rng(5)
    return rng.uniform(-1, 1, (400, 3)) * [1, 2, 0.7] + np.array([1.0, y, 0.7])


def frame(car, views, viewpoint, track=None, time=0.0):
    middle = np.mean(find_main_box(car), axis=0)
    return frame_thing(viewpoint, car, *NOTHING, find_sights(views, middle, track, time))


@pytest.mark.parametrize("away", [20.0, 60.0])
def test_a_far_thing_is_seen_large_from_the_place_of_a_photo(away):
    views, car = drive_along(), make_car(8.0 + away)
    found = frame(car, views, make_default_viewpoint())
    assert min(np.linalg.norm(found.position - view.camera.world_from_camera[:3, 3]) for view in views) < 1e-9
    pixels, depths = found.fit_camera(480, 270).project(car)
    assert (depths > 0).all()
    assert ((pixels > 0) & (pixels < (480, 270))).all()
    assert np.ptp(pixels[:, 0]) > 60, "10 pixels wide in the photo where it is 60 m away"
    assert 1 <= found.zoom <= MOST_ZOOM


def test_what_no_photo_shows_is_framed_as_before():
    behind = make_car(-20.0)
    views, start = drive_along(), make_default_viewpoint()
    np.testing.assert_array_equal(
        frame(behind, views, start).world_from_camera, frame_thing(start, behind, *NOTHING).world_from_camera
    )


def test_a_view_from_above_stays_one():
    above = replace(make_default_viewpoint(), world_from_camera=look_at(np.array([0.0, 0, 30]), np.array([0.0, 9, 0])))
    found = frame(make_car(25.0), drive_along(), above)
    assert found.forward[2] < -0.9
    assert found.zoom == 1.0


def test_a_driving_thing_is_seen_from_where_it_was_photographed_at_about_that_time():
    track = driving_track()
    car = make_car(0.0) - [1.0, 0.0, 0.7] + track.interpolate_pose(1.5)[:3, 3]
    views = drive_along(9)
    sights = find_sights(views, np.mean(find_main_box(car), axis=0), track, 1.5)
    assert sights
    assert min(sight.driven for sight in sights) < 0.5
    late = tuple(replace(view, time=view.time + 100) for view in views)
    assert find_sights(late, car.mean(axis=0), track, 1.5) == (), "its track does not reach that far"


def test_going_back_undoes_the_zoom_first_and_turning_is_finer():
    start = replace(make_default_viewpoint(), zoom=2.0)
    wider = dolly(start, 1.5)
    np.testing.assert_array_equal(wider.position, start.position)
    assert wider.zoom == pytest.approx(2.0 / 1.5)
    assert dolly(wider, 1.5).zoom == 1.0
    assert dolly(dolly(wider, 1.5), 1.5).pivot_distance > start.pivot_distance
    assert dolly(start, 0.5).pivot_distance == pytest.approx(start.pivot_distance / 2)
    plain = replace(start, zoom=1.0)
    turned = [np.arccos(np.clip(look(each, 0.1, 0.0).forward @ each.forward, -1, 1)) for each in (start, plain)]
    assert turned[0] == pytest.approx(turned[1] / 2, rel=1e-3)


def _rig_in_a_street(seed=5):
    """Points of two facades and a road, 60 m long, and photos of a car on it: ahead, backwards and to the left."""
    rng = np.random.default_rng(seed)
    along = rng.uniform(0, 60, 3000)
    sides = rng.choice([-8.0, 8.0], 3000)
    street = np.concatenate(
        [np.c_[along, sides, rng.uniform(0, 10, 3000)], np.c_[along, rng.uniform(-8, 8, 3000), np.zeros(3000)]]
    )
    ways = {"front": [1.0, 0, 0], "back": [-1.0, 0, 0], "left": [0, 1.0, 0]}
    views = []
    for step, x in enumerate((10.0, 30.0, 50.0)):
        for name, way in ways.items():
            place = np.array([x, 0.0, 1.6])
            camera = Camera(400.0, 400.0, 320.0, 180.0, 640, 360, look_at(place, place + way))
            views.append(CameraView(camera, name, step, 0.1 * step))
    return street, views


@pytest.mark.parametrize(("forward", "place", "way"), [([1.0, 0, 0], 10.0, 1.0), ([-1.0, 0, 0], 50.0, -1.0)])
def test_a_street_is_shown_as_the_photo_that_shows_most_in_about_that_direction(forward, place, way):
    street, views = _rig_in_a_street()
    found = find_overview(views, street, np.array(forward))
    np.testing.assert_allclose(found.position, [place, 0, 1.6])
    np.testing.assert_allclose(found.forward, [way, 0, 0], atol=1e-9)
    assert 5 < found.pivot_distance < 50


def test_what_the_photos_were_not_taken_in_has_no_overview():
    _, views = _rig_in_a_street()
    car = np.random.default_rng(6).uniform(-1, 1, (100, 3)) + np.array([40.0, 4.0, 1.0])
    assert find_overview(views, car, np.array([1.0, 0, 0])) is None
    assert find_overview((), car, np.array([1.0, 0, 0])) is None
