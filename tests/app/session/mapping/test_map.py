"""The map: its window onto the ground, its picture from above, and what is drawn over it."""

import time

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, ROAD, procedural_street

from instdrive_app.session.mapping.map_picture import draw_map, extract_ground, mark_instances, rescale_window
from instdrive_app.session.mapping.map_things import build_view_cone, find_at, find_extent, list_map_things
from instdrive_app.session.mapping.map_window import MapWindow, fit_map
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.scene.scene import scene_from_gaussians

WINDOW = MapWindow(0.0, 14.0, 0.1, 160, 360)


def test_places_and_pixels_are_each_others_inverse_and_zoom_keeps_the_place():
    x, y = WINDOW.to_place(30.0, 50.0)
    assert np.allclose(WINDOW.to_pixels(np.array([[x, y, 7.0]])), [[30.0, 50.0]])
    nearer = WINDOW.zoom(0.5, 30.0, 50.0)
    assert nearer.scale == pytest.approx(0.05)
    assert nearer.to_place(30.0, 50.0) == pytest.approx((x, y))
    assert WINDOW.drag(10.0, 5.0).to_place(40.0, 55.0) == pytest.approx((x, y))
    fitted = fit_map(np.array([(-10.0, 0.0), (10.0, 4.0)]), 200, 100)
    pixels = fitted.to_pixels(np.array([(-10.0, 0.0), (10.0, 4.0)]))
    assert (pixels > 5).all()
    assert (pixels < (195, 95)).all()
    assert WINDOW.zoom(1e9, 0, 0).scale < 1e3


def test_the_picture_shows_each_thing_where_it_is(street):
    picture = draw_map(extract_ground(street), WINDOW)
    for number, place in enumerate([(-3, 4), (3, 8), (-3, 13), (3, 18), (-3, 24)]):
        x, y = WINDOW.to_pixels(np.array([place], float))[0]
        assert picture.ids[int(y), int(x)] == FIRST_CAR + number
    x, y = WINDOW.to_pixels(np.array([(0.0, 11.0)]))[0].astype(int)
    assert picture.ids[y, x] == ROAD
    assert picture.rgba[y, x, 3] > 200
    assert DRIVING_CAR not in picture.ids, "what drives is drawn as a box, at any time"
    leaves = WINDOW.to_pixels(np.array([(-5.3, 8.0)]))[0].astype(int)
    assert picture.rgba[leaves[1], leaves[0], 3] > 100


def test_edits_are_seen(street):
    street.apply(RecolorInstances((FIRST_CAR,), "solid", (0.0, 1.0, 0.0)))
    street.apply(DeleteInstances((FIRST_CAR + 1,)))
    picture = draw_map(extract_ground(street), WINDOW)
    assert FIRST_CAR + 1 not in picture.ids
    assert np.median(picture.rgba[picture.ids == FIRST_CAR], axis=0)[1] > 200
    marked = mark_instances(picture, (FIRST_CAR,), (255, 0, 0))
    assert (marked != picture.rgba).any(axis=-1).sum() > (picture.ids == FIRST_CAR).sum()
    assert mark_instances(picture, (999,), (255, 0, 0)) is picture.rgba


def test_what_moves_has_a_track_and_a_box_at_its_time(street):
    (thing,) = list_map_things(street, 2.0)
    assert thing.ids == (DRIVING_CAR,)
    assert np.allclose(thing.path[[0, -1]], [(1.2, 9.0), (1.2, 21.0)])
    assert thing.box is not None
    assert np.allclose(thing.box.mean(axis=0), (1.2, 15.0))
    assert np.allclose(thing.box[0], (2.1, 17.2)), "the right front corner"
    assert find_at((thing,), 1.5, 13.5) == DRIVING_CAR
    assert find_at((thing,), 5.0, 13.5) == 0
    assert list_map_things(street, 9.0)[0].box is None
    street.apply(DeleteInstances((DRIVING_CAR,)))
    assert list_map_things(street, 2.0) == ()


def test_scenes_without_drive_and_without_splats():
    plain = procedural_street(0.4)
    bare = Document(scene_from_gaussians(plain.gaussians))
    extent = find_extent(bare, (), None)
    assert extent is not None
    window = fit_map(extent, 100, 200)
    assert (draw_map(extract_ground(bare), window).rgba[..., 3] > 0).mean() > 0.2
    empty = Document(scene_from_gaussians(plain.gaussians.select(np.zeros(0, np.int64))))
    assert find_extent(empty, (), None) is None
    assert not draw_map(extract_ground(empty), window).ids.any()


def test_the_cone_shows_where_the_view_looks(session):
    session.navigation.look_through(0)
    place, corners = build_view_cone(session.state.viewpoint, (480, 270), 10.0)
    assert np.allclose(place, (-0.6, -1.5))
    assert (corners[:, 1] > place[1] + 5).all()
    assert corners[0, 0] < place[0] < corners[1, 0], "the left side first"
    session.navigation.look_down(())
    assert len(build_view_cone(session.state.viewpoint, (480, 270), 10.0)[1]) == 0


def paint(session, window):
    end = time.monotonic() + 60
    while time.monotonic() < end:
        session.map.update(window, 0.05)
        found = session.map.picture
        if not session.map.is_painting and found is not None and found.window == window:
            return found
        time.sleep(0.01)
    raise AssertionError("the map was not painted")


def test_the_painter_follows_edits_and_not_the_selection(session, street):
    window = rescale_window(WINDOW, 0.5)
    first = paint(session, window)
    session.selection.select((FIRST_CAR,))
    assert paint(session, window) is first
    street.apply(DeleteInstances((FIRST_CAR,)))
    session.map.update(window, 0.05)
    assert session.map.is_painting
    assert FIRST_CAR not in paint(session, window).ids
    farther = window.zoom(2.0, 10, 10)
    assert paint(session, farther).window == farther
