"""Other ways of the recording car."""

import dataclasses
import json

import numpy as np
import pytest
from scenario_text import VERTEX, write_scenario_text

from instdrive_core.errors import DataError, OptionError
from instdrive_core.recording.ego_path import EgoChange, find_ego_way, parse_ego_change, reroute_views
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.ways.drawn_way import DrawnWay, describe_drawn_way, read_drawn_way

SPEED, STEP = 8.0, 0.1
NOWHERE = np.zeros(3)


def make_views(steps=60):
    """A rig of two cameras, the first one looking back, that drives along x."""
    views = []
    for index in range(steps):
        place = np.array([SPEED * STEP * index, 3.0, 1.5])
        for name, ahead in (("back", -1.0), ("left", 0.0)):
            pose = look_at(place, place + np.array([ahead, 0.0 if ahead else 1.0, 0.0]))
            views.append(CameraView(Camera(60, 60, 32, 24, 64, 48, pose), name, index, 5.0 + STEP * index))
    return tuple(views)


def list_places(views, name="back"):
    return np.array([view.camera.position for view in views if view.name == name])


def test_the_way_heads_where_the_car_drives_not_where_the_camera_looks():
    way = find_ego_way(make_views())
    np.testing.assert_allclose(way.world_from_box[0, :3, 1], [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(way.world_from_box[0, :3, 2], [0, 0, 1], atol=1e-9)


def test_a_shift_goes_to_the_left_and_turns_nothing():
    views = make_views()
    moved = reroute_views(views, [EgoChange("shift", 2.0)], NOWHERE)
    np.testing.assert_allclose(list_places(moved) - list_places(views), np.tile([0, 2.0, 0], (60, 1)), atol=1e-9)
    for old, new in zip(views, moved, strict=True):
        np.testing.assert_allclose(
            new.camera.world_from_camera[:3, :3], old.camera.world_from_camera[:3, :3], atol=1e-9
        )


def test_the_rig_stays_as_it_is_on_any_way():
    views = make_views()
    changes = [EgoChange("lane", -3.5, 1.0, 3.0), EgoChange("speed", 0.6)]
    moved = reroute_views(views, changes, NOWHERE)
    for old, new in zip(
        (views[place : place + 2] for place in range(0, len(views), 2)),
        (moved[place : place + 2] for place in range(0, len(views), 2)),
        strict=True,
    ):
        relative = [np.linalg.inv(a.camera.world_from_camera) @ b.camera.world_from_camera for a, b in (old, new)]
        np.testing.assert_allclose(relative[0], relative[1], atol=1e-9)


def test_a_change_of_lane_begins_and_ends_where_it_should_and_heads_along_its_way():
    views = make_views()
    places = list_places(reroute_views(views, [EgoChange("lane", 3.5, 1.0, 3.0)], NOWHERE))
    aside = places[:, 1] - 3.0
    np.testing.assert_allclose(aside[:10], 0, atol=1e-9)
    np.testing.assert_allclose(aside[41:], 3.5, atol=1e-9)
    assert (np.diff(aside) >= -1e-12).all()
    moved = reroute_views(views, [EgoChange("lane", 3.5, 1.0, 3.0)], NOWHERE)
    middle = [view for view in moved if view.name == "back"][25]
    driven = places[26] - places[24]
    looks = middle.camera.world_from_camera[:3, 2]
    assert np.dot(driven / np.linalg.norm(driven), looks) == pytest.approx(-1, abs=1e-3)


def test_a_slower_car_gets_less_far():
    places = list_places(reroute_views(make_views(), [EgoChange("speed", 0.5)], NOWHERE))
    np.testing.assert_allclose(places[-1, 0], 0.5 * SPEED * STEP * 59, atol=1e-9)


def test_a_stopping_car_brakes_smoothly_and_stands():
    places = list_places(reroute_views(make_views(), [EgoChange("stop", 2.0)], NOWHERE))
    speeds = np.diff(places[:, 0]) / STEP
    np.testing.assert_allclose(speeds[:19], SPEED, atol=1e-6)
    np.testing.assert_allclose(speeds[41:], 0, atol=1e-9)
    assert (np.diff(speeds) < 1e-9).all()
    assert places[-1, 0] == pytest.approx(SPEED * (2.0 + 1.0), abs=1e-6)


def test_a_way_too_short_to_tell_heads_where_the_camera_looks():
    still = tuple(dataclasses.replace(view, time=view.time) for view in make_views(1))
    np.testing.assert_allclose(find_ego_way(still).world_from_box[0, :3, 1], [-1, 0, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "change"),
    [
        ("shift=-1.5", EgoChange("shift", -1.5)),
        ("lane=3.5@2", EgoChange("lane", 3.5, 2.0)),
        ("lane=-3.5@2-6", EgoChange("lane", -3.5, 2.0, 4.0)),
        ("speed=0.5", EgoChange("speed", 0.5)),
        ("stop=3", EgoChange("stop", 3.0)),
    ],
)
def test_changes_are_parsed(text, change):
    assert parse_ego_change(text) == change


@pytest.mark.parametrize("text", ["", "left", "shift", "lane=3", "shift=80", "speed=2", "stop=-1", "lane=3@4-2"])
def test_what_is_no_change_is_said(text):
    with pytest.raises(OptionError):
        parse_ego_change(text)


def write_way(folder, **content):
    path = folder / "way.json"
    path.write_text(json.dumps(content))
    return path


CURVE = [{"x": 0.0, "y": 3.0}, {"x": 20.0, "y": 3.0}, {"x": 30.0, "y": 12.0}]


def test_a_drawn_way_is_driven_as_fast_as_recorded_or_by_number(tmp_path):
    views = make_views()
    for speed, expected in ((None, SPEED), (4.0, 4.0)):
        content = {"keys": CURVE} | ({} if speed is None else {"speed": speed})
        moved = reroute_views(views, [parse_ego_change(f"path={write_way(tmp_path, **content)}")], NOWHERE)
        places = list_places(moved)
        np.testing.assert_allclose(places[0], [0, 3, 1.5], atol=1e-6)
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        np.testing.assert_allclose(steps[5:15], expected * STEP, rtol=0.03)
        assert np.allclose(places[:, 2], 1.5), "as high as it was"
    np.testing.assert_allclose(list_places(reroute_views(views, [drawn(30.0)], NOWHERE))[-1], [30, 12, 1.5], atol=0.05)


def drawn(speed=None):
    return EgoChange("path", 0.0, drawn=DrawnWay(tuple((key["x"], key["y"]) for key in CURVE), speed))


def test_the_rig_turns_with_the_drawn_way_and_stays_as_it_is():
    views = make_views()
    moved = reroute_views(views, [drawn(30.0)], NOWHERE)
    relative = [
        np.linalg.inv(pair[0].camera.world_from_camera) @ pair[1].camera.world_from_camera
        for pair in (views[-2:], moved[-2:])
    ]
    np.testing.assert_allclose(relative[0], relative[1], atol=1e-9)
    back = next(view for view in reversed(moved) if view.name == "back").camera.world_from_camera[:3, 2]
    assert back[0] < -0.4, "it looks back along the bend"
    assert back[1] < -0.4


def test_a_drawn_way_has_times_of_its_own_and_is_changed_further(tmp_path):
    views = make_views()
    keys = [{"time": 5.0, "x": 0.0, "y": 3.0}, {"time": 7.0, "x": 0.0, "y": 3.0}, {"time": 9.0, "x": 10.0, "y": 3.0}]
    change = parse_ego_change(f"path={write_way(tmp_path, keys=keys)}")
    places = list_places(reroute_views(views, [change], NOWHERE))
    np.testing.assert_allclose(places[[0, 20, 40, -1], 0], [0, 0, 10, 10], atol=1e-6)
    aside = list_places(reroute_views(views, [change, EgoChange("shift", 2.0)], NOWHERE))
    np.testing.assert_allclose(aside[:, 1], 5.0, atol=1e-6)
    written = write_way(tmp_path, **describe_drawn_way(change.drawn))
    assert read_drawn_way(written) == change.drawn


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"keys": CURVE[:1]}, "holds no way"),
        ({"keys": [{"x": 1.0}, {"x": 2.0, "y": 1.0}]}, r"keys\[0\].y"),
        ({"keys": CURVE, "speed": -1}, "speed"),
        ({"keys": [{**CURVE[0], "time": 1.0}, CURVE[1]]}, "only some"),
        ({"keys": [{**CURVE[0], "time": 1.0}, {**CURVE[1], "time": 1.0}]}, r"keys\[1\].time"),
        ({"keys": [{**CURVE[0], "time": 1.0}, {**CURVE[1], "time": 2.0}], "speed": 3}, "does not go with"),
    ],
)
def test_files_that_hold_no_way_name_the_field(tmp_path, content, words):
    with pytest.raises(DataError, match=words):
        parse_ego_change(f"path={write_way(tmp_path, **content)}")


def test_a_way_that_leads_away_is_refused():
    far = EgoChange("path", 0.0, drawn=DrawnWay(((0.0, 3.0), (0.0, 90.0))))
    with pytest.raises(OptionError, match="87 m from the recorded one"):
        reroute_views(make_views(), [far], NOWHERE)


def test_a_scenario_says_where_the_car_is_at_which_time(tmp_path):
    views, origin = make_views(), np.array([1000.0, 2000.0, 30.0])
    line = VERTEX.format(4.5, 1000, 2003, "") + VERTEX.format(6.5, 1000, 2003, "") + VERTEX.format(8.5, 1010, 2003, "")
    path = write_scenario_text(tmp_path, line, names=("Ego", "Van"))
    for text in (f"path={path}", str(path), f"{path}#Van"):
        places = list_places(reroute_views(views, [parse_ego_change(text)], origin))
        np.testing.assert_allclose(places[[0, 20, 40, -1], 0], [0, 0, 10, 10], atol=1e-6)
        np.testing.assert_allclose(places[:, 1:], np.tile([3, 1.5], (60, 1)), atol=1e-6)


def test_a_scenarios_headings_count_where_every_vertex_has_one(tmp_path):
    line = VERTEX.format(4.5, 0, 3, 'h="0.5"') + VERTEX.format(8.5, 10, 3, 'h="0.5"')
    moved = reroute_views(make_views(), [parse_ego_change(str(write_scenario_text(tmp_path, line)))], NOWHERE)
    for view in (view for view in moved if view.name == "back"):
        np.testing.assert_allclose(view.camera.world_from_camera[:2, 2], [-np.cos(0.5), -np.sin(0.5)], atol=1e-6)


def test_whose_way_is_meant_and_a_single_vertex_are_told(tmp_path):
    with pytest.raises(OptionError, match=r"which way is meant.*Bus, Van"):
        parse_ego_change(str(write_scenario_text(tmp_path, names=("Bus", "Van"))))
    with pytest.raises(DataError, match="one vertex only"):
        parse_ego_change(str(write_scenario_text(tmp_path, VERTEX.format(0, 1, 2, ""))))
    with pytest.raises(DataError):
        parse_ego_change(f"path={tmp_path / 'missing.xosc'}")
