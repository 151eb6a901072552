"""Ways as OpenSCENARIO: what is written reads back here and elsewhere, and odd files say what is wrong."""

import math

import numpy as np
import pytest
from random_scene import random_scene
from scenario_text import LINE, TIMING, VERTEX, write_scenario_text

from instdrive_app.main import main
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.objects.scenario_ways import read_scenario_way
from instdrive_core.formats.objects.writers import write_objects
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.recording.ego_path import find_ego_way
from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import PathKey

NOWHERE = np.zeros(3)


def begin(condition):
    return f"<StartTrigger><ConditionGroup><Condition>{condition}</Condition></ConditionGroup></StartTrigger>"


def read(path, origin=NOWHERE, wanted=(), **options):
    return read_scenario_way(str(path), origin, wanted, **options)


@pytest.fixture
def scene():
    scene = random_scene(count=900, instances=6, actors=2)
    scene.gaussians.log_scales[:] = -3
    scene.gaussians.opacity_logits[:] = 3
    scene.origin = np.array([412_345.6, 5_312_345.6, 311.0])
    return scene


def test_ways_come_back_and_another_program_reads_them(scene, tmp_path):
    library = pytest.importorskip("scenariogeneration.xosc")
    path = tmp_path / "drive.xosc"
    written = write_objects(path, scene, 0.0, ego=find_ego_way(scene.views))
    assert len(written) >= 2
    scenario = library.ParseOpenScenario(str(path))
    entities = {entity.name: entity for entity in scenario.entities.scenario_objects}
    assert {"Ego", *(entry.instance.name for entry in written)} <= set(entities)
    for entry in written:
        track = entry.track
        keys = read(f"{path}#{entry.instance.name}", scene.origin)
        np.testing.assert_allclose([key.time for key in keys], track.times, atol=1e-9)
        np.testing.assert_allclose([(key.x, key.y) for key in keys], track.world_from_box[:, :2, 3], atol=1e-6)
        turns = np.exp(1j * np.array([key.heading for key in keys]))
        ahead = track.world_from_box[:, 0, 1] + 1j * track.world_from_box[:, 1, 1]
        np.testing.assert_allclose(turns, ahead / np.abs(ahead), atol=1e-9)
        box = entities[entry.instance.name].entityobject.boundingbox
        assert (box.boundingbox.width, box.boundingbox.length) == pytest.approx(tuple(track.dimensions[:2]))
    ego = find_ego_way(scene.views)
    keys = read(f"{path}#Ego", scene.origin)
    np.testing.assert_allclose([(key.x, key.y) for key in keys], ego.world_from_box[:, :2, 3], atol=1e-6)


def test_the_commands_write_ways_and_drive_them(scene, tmp_path, capsys):
    pytest.importorskip("scenariogeneration")
    save_scene(tmp_path / "scene", scene)
    assert main(["objects", str(tmp_path / "scene"), "-o", str(tmp_path / "drive.xosc")]) == 0
    assert "ways of" in capsys.readouterr().out
    mover = next(entry for entry in scene.table if entry.node)
    track = scene.actors[mover.node - 1]
    way = f"{mover.id}={tmp_path / 'drive.xosc'}"
    options = ["apply", str(tmp_path / "scene"), "-o", str(tmp_path / "edited"), "--no-shadows", "--path", way]
    assert main(options) == 0
    driven = open_scene(tmp_path / "edited").actors[mover.node - 1]
    for time, pose in zip(track.times.tolist(), track.world_from_box, strict=True):
        np.testing.assert_allclose(driven.interpolate_pose(time)[:2, 3], pose[:2, 3], atol=1e-5)


def test_what_drives_nowhere_is_not_written(scene, tmp_path):
    pytest.importorskip("scenariogeneration")
    scene.nodes[:] = 0
    with pytest.raises(DataError, match="nothing in the scene drives"):
        write_objects(tmp_path / "drive.xosc", scene, 0.0)


def test_a_way_is_that_of_the_middle_at_times_of_the_scenario(tmp_path):
    path = write_scenario_text(tmp_path)
    assert read(path, np.array([1.0, 2.0, 3.0])) == (PathKey(0.5, 5.5, 4.5), PathKey(2.5, 9.5, 4.5))
    assert read(path, follows_middle=False) == (PathKey(0.5, 5, 6), PathKey(2.5, 9, 6))
    north = VERTEX.format(0, 5, 6, f'h="{math.pi / 2}"')
    (key,) = read(write_scenario_text(tmp_path, north))
    assert (key.x, key.y, key.heading) == pytest.approx((4.5, 7.5, math.pi / 2))
    late = begin('<ByValueCondition><SimulationTimeCondition value="3" rule="greaterThan"/></ByValueCondition>')
    relative = write_scenario_text(tmp_path, timing=TIMING.format("relative"), start=late)
    assert [key.time for key in read(relative)] == [3.5, 5.5]
    parameters = '<ParameterDeclarations><ParameterDeclaration name="north" value="6"/></ParameterDeclarations>'
    named = write_scenario_text(tmp_path, LINE.replace('y="6"', 'y="$north"'))
    named.write_text(named.read_text().replace("<Entities>", parameters + "<Entities>"))
    assert read(named) == read(path)


def test_it_must_be_clear_whose_way_is_meant(tmp_path):
    path = write_scenario_text(tmp_path, names=("Car", "Van"))
    with pytest.raises(OptionError, match=r"drive.xosc#NAME with one of: Car, Van"):
        read(path)
    assert read(path, wanted=("Van", "17")) == read(f"{path}#Van")
    assert read(f"{path}#Car")[0].x == 5
    with pytest.raises(OptionError, match="'Bus' follows no trajectory; those that do: Car, Van"):
        read(f"{path}#Bus")
    twice = write_scenario_text(tmp_path, names=("Car", "Car"))
    with pytest.raises(DataError, match="2 trajectories"):
        read(twice)


WRONG = {
    "entities": ({"head": '<!DOCTYPE x [<!ENTITY a "aaaa">]>'}, "defines entities"),
    "nobody": ({"names": ()}, "no entity has a FollowTrajectoryAction"),
    "curve": ({"shape": "Nurbs"}, "trajectory of 'Van': has the shape Nurbs"),
    "no time": ({"line": LINE.replace('time="2"', "")}, r"Vertex\[1\]/@time is missing"),
    "text": ({"line": LINE.replace('x="9"', 'x="far"')}, r"Vertex\[1\]/Position/WorldPosition/@x is 'far'"),
    "infinite": ({"line": LINE.replace('x="9"', 'x="1e999"')}, "'1e999', expected a number"),
    "falling": ({"line": LINE.replace('time="2"', 'time="0"')}, r"Vertex\[1\] is not above"),
    "lane": ({"line": LINE.replace("WorldPosition", "LanePosition")}, r"Vertex\[0\] has LanePosition"),
    "empty": ({"line": ""}, "has no vertex"),
    "untimed": ({"timing": "<TimeReference><None/></TimeReference>"}, "nothing says when"),
    "domain": ({"timing": TIMING.format("lunar")}, "domainAbsoluteRelative is 'lunar'"),
    "unknown start": (
        {"timing": TIMING.format("relative"), "start": begin("<ByEntityCondition/>")},
        "Event 'e', from which its times count",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_files_name_the_element(case, tmp_path):
    options, words = WRONG[case]
    with pytest.raises(DataError, match=words):
        read(write_scenario_text(tmp_path, **options))


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "drive.xosc"
    path.write_text("<OpenDRIVE/>")
    with pytest.raises(DataError, match="is <OpenDRIVE>, not <OpenSCENARIO>"):
        read(path)
    path.write_bytes(b" " * (16 << 20) + b"<OpenSCENARIO/>")
    with pytest.raises(DataError, match="longer than 16 MiB"):
        read(path)


def test_a_parked_recording_car_has_no_line(tmp_path, scene):
    pytest.importorskip("scenariogeneration")
    parked = Track("ego", "ego", np.ones(3), np.zeros(1), np.eye(4)[None], False)
    write_objects(tmp_path / "drive.xosc", scene, 0.0, ego=parked)
    with pytest.raises(OptionError, match="'Ego' follows no trajectory"):
        read(f"{tmp_path / 'drive.xosc'}#Ego")
