"""A jam: vehicles stop and go, keep clear of each other, and are recorded like any other street."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from instdrive_core.datasets.synthetic.config import CONFIG_FILE, JAM, StreetConfig
from instdrive_core.datasets.synthetic.units import StreetUnits
from instdrive_core.datasets.synthetic.world.jam import plan_jam
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.pace import StopAndGo
from instdrive_core.datasets.synthetic.world.street import Route, Street
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import OptionError
from instdrive_core.scene.track import find_points_inside

TINY = StreetConfig(seed=3, steps=2, width=64, height=36, lidar_azimuths=200, traffic=JAM)


@pytest.fixture(scope="module")
def street() -> Street:
    return build_street(TINY)


def test_a_pace_stops_and_goes_and_its_speed_is_that_of_its_way() -> None:
    pace = StopAndGo(lead=2.3, top_speed=3.0, period=6.0, standing=1.5)
    times = np.linspace(0, 12, 2401)
    way = np.array([pace.travel(time) for time in times])
    speeds = np.array([pace.compute_speed(time) for time in times])
    assert way[0] == 0
    assert (np.diff(way) >= 0).all()
    np.testing.assert_allclose(np.gradient(way, times)[1:-1], speeds[1:-1], atol=0.02)
    assert speeds.max() == pytest.approx(3.0, abs=0.01)
    assert (speeds == 0).mean() == pytest.approx(1.5 / 6.0, abs=0.01)


def test_vehicles_of_a_jam_move_and_keep_clear_of_each_other(street: Street) -> None:
    vehicles = [actor for actor in street.actors if actor.motion is not None]
    driving = [number for number, actor in enumerate(vehicles) if actor.motion == "Moving"]
    assert len(driving) > 40
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0, 0.5) for z in (-0.4, 0.4)])
    ego = np.array([2.0, 4.8, 1.6])
    for time in (0.0, 2.0, 5.5, 30.0):
        poses = np.array([street.box_pose(actor, time) for actor in vehicles])
        own = street.ego.pose(time, street.height)
        for number in driving:
            outline = corners * vehicles[number].dimensions @ poses[number, :3, :3].T + poses[number, :3, 3]
            assert not find_points_inside(outline, own, ego).any()
            near = np.linalg.norm(poses[:, :2, 3] - poses[number, :2, 3], axis=1) < 8
            near[number] = False
            for other in np.flatnonzero(near):
                assert not find_points_inside(outline, poses[other], vehicles[other].dimensions).any()
    ways = np.array([vehicles[number].route.travel(3.0) for number in driving])
    assert ways.max() < 10
    assert (ways > 0.3).mean() > 0.9


def test_the_recording_car_of_a_jam_needs_a_pace() -> None:
    with pytest.raises(ValueError, match="needs a pace"):
        plan_jam(Route(0.0, 0.0, speed=7.0), np.random.default_rng(0))


def test_a_recorded_jam_says_so_and_older_streets_flow(tmp_path: Path) -> None:
    write_street(tmp_path / "clip", TINY)
    file = tmp_path / "clip" / CONFIG_FILE
    config = json.loads(file.read_text())
    assert config["traffic"] == "jam"
    assert StreetUnits(tmp_path / "clip").street is build_street(TINY)
    instances = json.loads((tmp_path / "clip" / "labels" / "instances.json").read_text())
    assert {item["class"] for item in instances.values()} >= {"Car", "Building"}
    del config["traffic"]
    file.write_text(json.dumps(config))
    flowing = StreetUnits(tmp_path / "clip").street
    assert flowing.ego.pace is None


def test_refuses_traffic_it_does_not_know() -> None:
    with pytest.raises(OptionError, match="traffic is 'busy'; choose 'flowing' or 'jam'"):
        StreetConfig(traffic="busy")
