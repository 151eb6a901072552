"""Which of a street's fixtures a scene's instance stands for, and the street without them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.gaps import find_fixtures, remove_fixtures
from benchmarks.hole_streets import photograph
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.world.layout import build_street
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.scene.camera import Camera


@pytest.fixture(scope="module")
def street() -> Street:
    return build_street(StreetConfig(seed=3, steps=2))


def test_a_fixture_belongs_to_the_instance_that_most_of_its_pixels_show(street: Street) -> None:
    labels = np.array([[1, 1, 1, 2, 2, 2, 0]], np.int32)
    ids = np.array([[7, 7, 4, 7, 4, 4, 7]], np.int32)

    assert find_fixtures(street, 7, [(labels, ids)]).tolist() == [1]
    assert find_fixtures(street, 4, [(labels, ids)]).tolist() == [2]


def test_removing_a_fixture_shows_what_it_hid_and_changes_nothing_else(street: Street) -> None:
    camera = Camera(60.0, 60.0, 48.0, 27.0, 96, 54, _look_along_the_street())
    image, labels = photograph(street, camera, 0.0, street.light)
    number = int(np.bincount(labels[(labels > 0) & (labels <= len(street.fixtures))]).argmax())

    bare, without = photograph(remove_fixtures(street, np.array([number])), camera, 0.0, street.light)

    assert not (without == number).any()
    others = labels != number
    assert (without[others] == labels[others]).all()
    assert (bare[~others] != image[~others]).any()


def _look_along_the_street() -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0.0]])
    pose[:3, 3] = (0, 0, 1.6)
    return pose
