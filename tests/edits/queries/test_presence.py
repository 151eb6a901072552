"""When moving things are there, and the time to go to where they are not."""

from dataclasses import replace

import pytest
from procedural_street import DRIVING_CAR, procedural_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.presence import find_time_there, list_passing

STEPS = (0.0, 0.5, 1.0, 1.5)


@pytest.fixture
def late():
    """A street through which a car drives from 1.0 s on."""
    scene = procedural_street()
    track = scene.actors[0]
    actor = replace(track, times=track.times[2:], world_from_box=track.world_from_box[2:])
    return Document(replace(scene, actors=(actor,)))


def test_what_is_there_all_the_time_does_not_pass(late):
    standing = next(each.id for each in late.scene.table if not each.node)
    assert list_passing(late, (standing,), STEPS) == ()
    assert [track.id for track in list_passing(late, (standing, DRIVING_CAR), STEPS)] == ["driver"]
    assert list_passing(late, (DRIVING_CAR,), STEPS[2:]) == ()


def test_the_nearest_time_at_which_it_is_there(late):
    standing = next(each.id for each in late.scene.table if not each.node)
    assert find_time_there(late, (DRIVING_CAR,), STEPS, 0.2) == 1.0
    assert find_time_there(late, (DRIVING_CAR,), STEPS, 1.5) == 1.5
    assert find_time_there(late, (DRIVING_CAR,), STEPS[:2], 0.2) == 0.2, "no step shows it"
    assert find_time_there(late, (DRIVING_CAR, standing), STEPS, 0.2) == 0.2, "something of it is there"
