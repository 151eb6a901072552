"""Poses of an actor as JSON."""

import json

import numpy as np
import pytest
from random_scene import random_track

from instdrive_core.errors import DataError
from instdrive_core.formats.objects.poses import read_poses, write_poses


def test_poses_come_back(tmp_path):
    track, origin = random_track(np.random.default_rng(0), "actor – “1”", 0.4), np.array([500000.0, 4.2e6, 12.5])
    write_poses(tmp_path / "car.poses.json", track, origin, "car.spz")
    found, found_origin, splats = read_poses(tmp_path / "car.poses.json")
    assert (found.id, found.label, found.moving) == (track.id, track.label, track.moving)
    np.testing.assert_array_equal(found.times, track.times)
    np.testing.assert_array_equal(found.dimensions, track.dimensions)
    np.testing.assert_array_equal(found_origin, origin)
    np.testing.assert_allclose(found.world_from_box, track.world_from_box, rtol=0, atol=1e-7)
    assert splats == tmp_path / "car.spz"


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content | {"format": "instdrive objects"},
        lambda content: content | {"track": content["track"] | {"times": [0.0]}},
        lambda content: content | {"track": content["track"] | {"rotations": [["a", 0, 0, 0]]}},
        lambda content: {key: value for key, value in content.items() if key != "origin"},
        lambda content: [content],
    ],
)
def test_what_holds_no_poses_is_refused(tmp_path, damage):
    path = tmp_path / "car.poses.json"
    write_poses(path, random_track(np.random.default_rng(0), "a"), np.zeros(3), "car.ply")
    path.write_text(json.dumps(damage(json.loads(path.read_text()))))
    with pytest.raises(DataError, match=r"car\.poses\.json"):
        read_poses(path)


def test_the_splats_lie_in_the_same_folder(tmp_path):
    path = tmp_path / "car.poses.json"
    write_poses(path, random_track(np.random.default_rng(0), "a"), np.zeros(3), "../../elsewhere/car.ply")
    assert read_poses(path)[2] == tmp_path / "car.ply"
