"""From a first start to an exported scene without one car, in few actions, by true mouse and keys."""

import shutil

import pytest

from benchmarks.first_walk import count_filled, take_walk

pytestmark = pytest.mark.gui

MOST_ACTIONS = 8


def test_a_car_is_deleted_filled_and_exported_in_few_actions():
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    walk, scene = take_walk()
    assert len(walk.actions) <= MOST_ACTIONS, walk.actions
    assert walk.car
    assert walk.car not in scene.table
    assert count_filled(scene) > 100
