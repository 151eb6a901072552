"""Ways of vehicles: where they are, where they look, and templates that change a way."""

import json
import math

import numpy as np
import pytest
from edit_cases import BUS, CAR, ROAD, TAXI, rich_document

from instdrive_core.cli.apply import apply
from instdrive_core.cli.driving.path_options import PathOptions
from instdrive_core.edits.kinds.driving.set_path import SetPath
from instdrive_core.edits.kinds.driving.start_driving import StartDriving
from instdrive_core.edits.kinds.driving.ways import change_way, drive_instance, park_at
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import DataError, EditError, OptionError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import (
    PathKey,
    change_lane,
    change_speed,
    sample_path,
    stop_at,
    trace_way,
    turn_off,
)
from instdrive_core.scene.ways.way_file import read_way

STRAIGHT = (PathKey(0.0, 0.0, 0.0), PathKey(10.0, 50.0, 0.0))
"""5 m/s along x."""


def at(keys, *times):
    return sample_path(keys, np.array(times, float))


def test_a_way_passes_its_keys_and_stands_before_and_after():
    keys = (PathKey(1.0, 0, 0), PathKey(2.0, 4, 0), PathKey(3.0, 4, 0), PathKey(5.0, 4, 6))
    found = at(keys, 0.0, 1.0, 2.0, 2.5, 3.0, 5.0, 9.0)
    np.testing.assert_allclose(found.places, [[0, 0], [0, 0], [4, 0], [4, 0], [4, 0], [4, 6], [4, 6]], atol=1e-9)
    fine = at(keys, *np.linspace(1, 5, 400))
    assert fine.places[:, 0].max() <= 4 + 1e-9, "it never overshoots where it stands"
    steps = np.linalg.norm(np.diff(fine.places, axis=0), axis=1)
    assert np.abs(np.diff(steps)).max() < 0.01, "speed does not jump"


def test_headings_follow_the_way_and_stay_where_it_stands():
    keys = (PathKey(0, 0, 0), PathKey(2, 10, 0), PathKey(4, 10, 0), PathKey(6, 10, 10))
    headings = at(keys, 0.0, 1.0, 3.0, 3.9, 5.0, 6.0).headings
    np.testing.assert_allclose(headings[:3], 0, atol=0.2)
    np.testing.assert_allclose(headings[-2:], math.pi / 2, atol=0.05)
    assert at((PathKey(0, 3, 4),), 1.0).headings.tolist() == [0.0]
    own = (PathKey(0, 0, 0, 3.0), PathKey(1, 1, 0, -3.0))
    np.testing.assert_allclose(at(own, 0.5).headings % (2 * math.pi), math.pi, atol=1e-6)


def test_a_change_of_lane_is_beside_the_old_way_and_as_fast():
    found = at(change_lane(STRAIGHT, 3.5, 2.0), 1.9, 5.1, 9.0)
    np.testing.assert_allclose(found.places[:, 1], [0, 3.5, 3.5], atol=0.02)
    np.testing.assert_allclose(found.places[:, 0], [9.5, 25.5, 45], atol=0.1)
    assert at(change_lane(STRAIGHT, -2.0, 2.0), 9.0).places[0, 1] == pytest.approx(-2, abs=0.02)


def test_braking_stands_after_two_seconds_and_five_metres():
    found = at(stop_at(STRAIGHT, 4.0), 4.0, 6.0, 9.0)
    np.testing.assert_allclose(found.places[:, 0], [20, 25, 25], atol=0.05)


def test_speed_changes_where_it_is_not_where_it_goes():
    slow = at(change_speed(STRAIGHT, 0.5, 2.0), 2.0, 6.0, 10.0)
    np.testing.assert_allclose(slow.places[:, 0], [10, 20, 30], atol=0.05)
    fast = at(change_speed(STRAIGHT, 4.0, 0.0), 1.0, 5.0)
    np.testing.assert_allclose(fast.places[:, 0], [20, 50], atol=0.3)


@pytest.mark.parametrize("degrees", [90, -90, 45])
def test_turning_off_ends_in_the_wanted_direction_at_the_same_speed(degrees):
    keys = turn_off(STRAIGHT, math.radians(degrees), 2.0)
    found = at(keys, 0.0, 2.0, 9.5, 10.0)
    np.testing.assert_allclose(found.places[1], [10, 0], atol=0.05)
    assert found.headings[-1] == pytest.approx(math.radians(degrees), abs=0.03)
    assert np.linalg.norm(found.places[3] - found.places[2]) == pytest.approx(2.5, abs=0.1)


def test_a_mover_drives_on_the_ground_and_is_there_all_the_time():
    document = rich_document()
    node = document.scene.table[TAXI].node
    old = document.scene.actors[node - 1]
    document.apply(SetPath(TAXI, ((0.0, -2.0, -2.0), (0.4, 2.0, -2.0))))
    track = document.scene.actors[node - 1]
    assert (track.id, track.label) == (old.id, old.label)
    np.testing.assert_array_equal(track.dimensions, old.dimensions)
    first = min(each.times[0] for each in document.scene.actors)
    assert track.times[0] <= first
    pose = track.interpolate_pose(0.2)
    np.testing.assert_allclose(pose[:2, 3], [0, -2], atol=0.1)
    np.testing.assert_allclose(pose[:3, 1], [1, 0, 0], atol=0.05)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    document.undo()
    assert document.scene.actors[node - 1] is old


def test_parking_keeps_place_and_heading():
    document = rich_document()
    entry = document.scene.table[BUS]
    track = document.scene.actors[entry.node - 1]
    pose = track.interpolate_pose(0.15)
    edit = drive_instance(entry, park_at(track, 0.15))
    document.apply(edit)
    assert edit.title == f"Park instance {BUS}"
    parked = document.scene.actors[entry.node - 1]
    assert not parked.moving
    for time in (parked.times[0], parked.times[-1]):
        found = parked.interpolate_pose(float(time))
        np.testing.assert_allclose(found[:2, 3], pose[:2, 3], atol=1e-6)
        np.testing.assert_allclose(found[:2, 1], pose[:2, 1] / np.linalg.norm(pose[:2, 1]), atol=1e-6)


def test_what_stands_still_starts_driving_with_its_looks():
    document = rich_document()
    rows = document.find_rows((CAR,))
    rows = rows[(document.state.flags[rows] & (Flag.DELETED | Flag.LOCKED)) == 0]
    before = document.compute_means(rows)
    center = before.mean(axis=0)
    way = ((0.0, float(center[0]), float(center[1])), (0.5, float(center[0]) + 3, float(center[1])))
    adding = StartDriving(CAR, way)
    document.apply(adding)
    (copy,) = adding.added_ids
    entry = document.scene.table[copy]
    track = document.scene.actors[entry.node - 1]
    assert (entry.class_name, track.moving) == (document.scene.table[CAR].class_name, True)
    added = document.find_rows((copy,))
    assert len(added) == len(rows)
    pose = track.interpolate_pose(float(track.times[0]))
    local = document.scene.gaussians.means[added]
    assert np.abs(local).max() < 3, "in the axes of its box"
    moved = track.interpolate_pose(0.5)[:3, 3] - pose[:3, 3]
    np.testing.assert_allclose(moved[:2], [3, 0], atol=0.05)
    spread = np.ptp(before, axis=0)
    np.testing.assert_allclose(np.sort(np.ptp(local, axis=0)[:2]), np.sort(spread[:2]), rtol=0.35)
    with pytest.raises(EditError, match="drives already"):
        document.apply(StartDriving(copy, way))
    with pytest.raises(EditError, match="stands still"):
        document.apply(SetPath(CAR, way))


def test_what_starts_driving_leaves_its_place():
    document = rich_document()
    document.apply(drive_instance(document.scene.table[CAR], (PathKey(0, 0, 0), PathKey(1, 1, 1))))
    baked = bake_document(document)
    assert CAR not in {entry.id for entry in baked.table}
    assert len(baked.actors) == 3
    document.undo()
    assert len(document.scene.actors) == 2


WRONG_KEYS = {
    "none": ((), "1 to"),
    "falling times": (((1, 0, 0), (0.5, 1, 1)), "rise"),
    "too short": (((0.0, 1.0),), "key 1"),
    "endless": (((0, 0, 0), (1e6, 1, 1)), "hour"),
    "no number": (((0.0, float("nan"), 0.0),), "key 1"),
}


@pytest.mark.parametrize("case", WRONG_KEYS)
def test_wrong_keys_are_told(case):
    keys, words = WRONG_KEYS[case]
    with pytest.raises(EditError, match=words):
        SetPath(TAXI, keys)


def test_the_command_takes_files_templates_and_parking(tmp_path):
    save_scene(tmp_path / "street", bake_document(rich_document()))
    (tmp_path / "way.json").write_text(json.dumps({"keys": [{"time": 0, "x": 0, "y": 0}, {"time": 1, "x": 3, "y": 0}]}))
    paths = PathOptions(path=(f"{CAR}={tmp_path / 'way.json'}", f"{TAXI}=lane:1@0.1"), park=(f"{BUS}@0.2",))
    apply(tmp_path / "street", out=tmp_path / "edited", paths=paths)
    found, old = open_scene(tmp_path / "edited"), open_scene(tmp_path / "street")
    assert len(found.actors) == len(old.actors) + 1
    by_id = {track.id: track for track in found.actors}
    assert not by_id[old.actors[old.table[BUS].node - 1].id].moving
    new = by_id[f"instance {CAR}"]
    np.testing.assert_allclose(new.interpolate_pose(1.0)[:2, 3], [3, 0], atol=1e-6)


WRONG_FILES = {
    "no keys": ({}, "keys"),
    "empty": ({"keys": []}, "no key"),
    "text": ({"keys": [{"time": 0, "x": "a", "y": 0}]}, r"keys\[0\].x"),
    "missing": ({"keys": [{"time": 0, "y": 0}]}, r"keys\[0\].x"),
    "falling": ({"keys": [{"time": 1, "x": 0, "y": 0}, {"time": 1, "x": 0, "y": 0}]}, r"keys\[1\].time"),
}


@pytest.mark.parametrize("case", WRONG_FILES)
def test_wrong_files_name_the_field(tmp_path, case):
    content, words = WRONG_FILES[case]
    (tmp_path / "way.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=words):
        read_way(tmp_path / "way.json")


@pytest.mark.parametrize("change", ["wait:2@0", "start@0.1", "stop@0.1", "speed:0.5@0"])
def test_changes_of_time_keep_the_way_on_its_line(change):
    document = rich_document()
    track = document.scene.actors[document.scene.table[TAXI].node - 1]
    (edit,) = PathOptions(path=(f"{TAXI}={change}",)).edits(document)
    assert isinstance(edit, SetPath)
    keys = np.array([key[1:3] for key in edit.keys])
    fine = sample_path(trace_way(track), np.linspace(track.times[0], track.times[-1], 300)).places
    apart = np.linalg.norm(keys[:, None] - fine[None], axis=2).min(axis=1)
    assert apart.max() < 0.05
    end = fine[-1] - fine[0]
    assert np.linalg.norm(keys[-1] - keys[0]) < np.linalg.norm(end), "it gets less far"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"path": (f"{TAXI}=stop:3@1",)}, "no change of a way"),
        ({"path": (f"{TAXI}=speed:11@0",)}, "no change of a way"),
        ({"path": (f"{TAXI}=wait@3",)}, "no change of a way"),
        ({"path": (f"{TAXI}=start:2@3",)}, "no change of a way"),
        ({"path": (f"{ROAD}=stop@1",)}, "stands still"),
        ({"path": (f"{TAXI}=none.json",)}, "none.json"),
        ({"park": (f"{TAXI}",)}, "--park"),
        ({"park": (f"{ROAD}@1",)}, "stands still"),
        ({"park": ("99@1",)}, "99"),
    ],
)
def test_wrong_options_are_told(options, words):
    with pytest.raises((OptionError, DataError), match=words):
        PathOptions(**options).edits(rich_document())


def test_the_way_of_a_track_is_traced():
    times = np.linspace(0, 4, 41)
    poses = np.tile(np.eye(4), (41, 1, 1))
    poses[:, 0, 3] = 2 * times
    track = Track("a", "Car", np.ones(3), times, poses, True)
    keys = trace_way(track)
    assert len(keys) == 9
    np.testing.assert_allclose(at(keys, 1.3).places, [[2.6, 0]], atol=1e-9)
    assert change_way(track, "stop", 0, 1.0)[-1].x == pytest.approx(4, abs=0.01)
