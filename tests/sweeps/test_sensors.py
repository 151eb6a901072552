"""Sensors by name and by file, those of clips, and intensities learned from their points."""

import json

import numpy as np
import pytest
from test_cast_rays import FAR_WALL, NEAR_PANEL, PANEL, WALL, make_scene

from instdrive_core.datasets.clip import Clip, Sweep, SweepPoints
from instdrive_core.errors import DataError, OptionError
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.sweeps.intensity import learn_intensities
from instdrive_core.sweeps.pattern import trace_pattern
from instdrive_core.sweeps.place import find_sensor_place
from instdrive_core.sweeps.rig import build_rig
from instdrive_core.sweeps.sensor import SENSORS, find_sensor

GOOD = {"elevations_deg": [-10, 0, 5], "columns": 36, "rate_hz": 10, "range_m": [1, 60], "place_m": [1, 0, 0.5]}


def views_at(times, names=("front", "left")):
    """Cameras of a rig that drives along x at 10 m/s, looking ahead."""
    made = []
    for step, time in enumerate(times):
        for number, name in enumerate(names):
            pose = np.eye(4)
            pose[:3, :3] = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
            pose[:3, 3] = (10 * time, number, 1.5)
            made.append(CameraView(Camera(40.0, 40.0, 16.0, 9.0, 32, 18, pose), name, step, time, "", False))
    return made


def sweep_of(points, time=0.1, intensity=0.5):
    count = len(points)
    found = SweepPoints(
        points.astype(np.float32), np.full(count, intensity, np.float32), np.zeros(count, np.uint8), None, None, None
    )
    return Sweep(1, time, lambda: found)


@pytest.mark.parametrize("name", SENSORS)
def test_known_sensors_look_all_around_in_one_turn(name):
    pattern, about = find_sensor(name), SENSORS[name]
    assert len(pattern.directions) == about["beams"] * about["columns"]
    np.testing.assert_allclose(np.linalg.norm(pattern.directions, axis=1), 1, atol=1e-6)
    low, high = np.degrees(np.arcsin(pattern.directions[:, 2].astype(float)[[0, about["beams"] - 1]]))
    assert (low, high) == pytest.approx(tuple(about["field_deg"]), abs=1e-3)
    assert np.ptp(pattern.delays) == pytest.approx(1 / about["rate_hz"], rel=1e-2)


def test_a_file_describes_a_sensor(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(GOOD))
    pattern = find_sensor(str(tmp_path / "a.json"))
    assert len(pattern.delays) == 108
    assert (pattern.near, pattern.far, pattern.place.tolist()) == (1, 60, [1, 0, 0.5])


WRONG = {
    "columns": 0,
    "rate_hz": "fast",
    "range_m": [9, 3],
    "elevations_deg": [100],
    "noise_m": -1,
    "place_m": [0, 1],
}


@pytest.mark.parametrize("field", WRONG)
def test_wrong_fields_are_named(tmp_path, field):
    (tmp_path / "a.json").write_text(json.dumps(GOOD | {field: WRONG[field]}))
    with pytest.raises(DataError, match=field.partition("_")[0] if field != "elevations_deg" else "beams"):
        find_sensor(str(tmp_path / "a.json"))


def test_an_unknown_sensor_lists_the_known_ones():
    with pytest.raises(OptionError, match="VLP-16"):
        find_sensor("VLP-17")


def test_the_place_of_a_sensor_is_that_from_which_sweeps_look_in_equal_directions():
    """Sixteen beams, a room of other walls in each sweep, a sensor that sits aside."""
    rig, seat = build_rig(views_at([0.0, 0.1, 0.2])), np.array([-0.42, 0.11, 0.33])
    beams, turns = np.radians(np.linspace(-12, 6, 16)), np.radians(np.arange(0, 360, 1.5))
    height, turn = (each.ravel() for each in np.meshgrid(beams, turns))
    aims = np.c_[np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)]
    sweeps = []
    for number in range(2):
        reach = 14 + 3 * number + (4 + number) * np.sin(3 * turn + number) + 30 * (height > 0.05)
        places, axes = rig.place(np.full(len(aims), 0.1))
        points = places + np.einsum("nij,nj->ni", axes, seat + reach[:, None] * aims)
        sweeps.append(sweep_of(points))
    place = find_sensor_place(rig, sweeps)
    np.testing.assert_allclose(place, seat, atol=0.06)
    pattern = trace_pattern(rig, 0.1, sweeps[0].load(), place)
    rays = pattern.aim(rig, 0.1)
    reached = rays.origins + pattern.ranges[:, None] * rays.directions
    np.testing.assert_allclose(reached, sweeps[0].load().points, atol=1e-4)
    assert find_sensor_place(rig, sweeps[:1]).tolist() == [0.0, 0.0, 0.4], "one sweep does not say it"


def test_steps_without_all_cameras_are_passed_over():
    views = views_at([0.0, 0.1, 0.2])
    rig = build_rig([view for view in views if (view.index, view.name) != (1, "left")])
    assert rig.times.tolist() == [0.0, 0.2]
    with pytest.raises(OptionError, match="camera"):
        build_rig([])


def test_intensities_come_from_the_points_on_each_splat():
    scene = make_scene([FAR_WALL, NEAR_PANEL], [WALL, PANEL])
    sweeps = (sweep_of(FAR_WALL[::3], intensity=0.9), sweep_of(NEAR_PANEL[::2], intensity=0.2))
    clip = Clip("", "", np.zeros(3), (), sweeps, (), {}, ())
    learned = learn_intensities(scene, clip)
    np.testing.assert_allclose(learned[scene.instance_ids == WALL], 0.9, atol=1e-6)
    np.testing.assert_allclose(learned[scene.instance_ids == PANEL], 0.2, atol=1e-6)
