"""Camera paths in files, also in damaged ones."""

import json

import numpy as np
import pytest

from instdrive_core.errors import DataError
from instdrive_core.filming.camera_path import CameraKey
from instdrive_core.filming.path_file import FIELD, read_camera_path, write_camera_path
from instdrive_core.scene.camera import Camera, look_at

POSE = look_at(np.array([1.0, 2.0, 3.0]), np.array([0.0, 9.0, 0.0]))
KEYS = tuple(CameraKey(at, 2 * at, Camera(50.0, 51.0, 30.0, 20.0, 64, 48, POSE)) for at in (0.0, 1.5))


def test_keys_come_back(tmp_path):
    write_camera_path(tmp_path / "path.json", KEYS)
    found = read_camera_path(tmp_path / "path.json")
    assert [(key.at, key.time) for key in found] == [(0.0, 0.0), (1.5, 3.0)]
    assert np.array_equal(found[1].camera.world_from_camera, POSE)
    assert (found[1].camera.fy, found[1].camera.width) == (51.0, 64)


@pytest.mark.parametrize(
    ("damage", "named"),
    [
        (lambda stored: stored.pop(FIELD), "has no key"),
        (lambda stored: stored.update({FIELD: 3}), "no list"),
        (lambda stored: stored[FIELD][1].pop("at"), r"camera_path\[1\].at' is missing"),
        (lambda stored: stored[FIELD][1].update(at=-1.0), r"camera_path\[1\].at' is -1, not later"),
        (lambda stored: stored[FIELD][0].update(time="noon"), r"camera_path\[0\].time' is 'noon'"),
        (lambda stored: stored[FIELD][0]["lens"].update(width=0), r"camera_path\[0\].lens"),
        (lambda stored: stored[FIELD][0].update(world_from_camera=[[1]]), r"camera_path\[0\].world_from_camera"),
        (lambda stored: stored[FIELD][0].update(lens=None), r"camera_path\[0\].lens.fx' is missing"),
    ],
)
def test_damaged_files_are_refused_with_their_field(tmp_path, damage, named):
    path = tmp_path / "path.json"
    write_camera_path(path, KEYS)
    stored = json.loads(path.read_text())
    damage(stored)
    path.write_text(json.dumps(stored))
    with pytest.raises(DataError, match=named):
        read_camera_path(path)
