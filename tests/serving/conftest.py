"""A street with a parked car and one that drives, and a server of it."""

from dataclasses import replace

import numpy as np
import pytest
from parked_street import CAR_SIZE, OTHER_CAR, parked_street

from instdrive_core.formats.registry import save_scene
from instdrive_core.scene.track import Track
from instdrive_core.serving.client import SensorClient
from instdrive_core.serving.server import SensorServer
from instdrive_core.serving.service import open_sensor_service


def driving_street():
    """The parked street, its other car driving 6 m/s ahead."""
    scene = parked_street().scene
    rows = np.flatnonzero(scene.instance_ids == OTHER_CAR)
    center = scene.gaussians.means[rows].mean(axis=0)
    means, nodes = scene.gaussians.means.copy(), scene.nodes.copy()
    means[rows] -= center
    nodes[rows] = 1
    times = 0.1 * np.arange(12)
    poses = np.tile(np.eye(4), (12, 1, 1))
    poses[:, :3, 3] = center + np.c_[np.zeros(12), 6 * times - 8, np.zeros(12)]
    track = Track("driven-1", "Car", CAR_SIZE.copy(), times, poses, moving=True)
    return replace(scene, gaussians=replace(scene.gaussians, means=means), nodes=nodes, actors=(track,))


@pytest.fixture(scope="session")
def street(tmp_path_factory):
    """A folder with the driving street."""
    folder = tmp_path_factory.mktemp("served") / "street"
    save_scene(folder, driving_street())
    return folder


@pytest.fixture(scope="session")
def service(street):
    return open_sensor_service(street)[0]


@pytest.fixture(scope="session")
def server(service):
    with SensorServer(service) as running:
        yield running


@pytest.fixture
def client(server):
    with SensorClient(server.address) as connected:
        yield connected
