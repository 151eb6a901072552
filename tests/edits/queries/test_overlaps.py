"""What is put somewhere and reaches into other things is found: parked or driving, deep or only near."""

import numpy as np
import pytest
from parked_street import CAR, OTHER_CAR, WALL, parked_street
from procedural_street import DRIVING_CAR, FIRST_CAR, procedural_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.queries.overlaps import describe_overlap, find_overlaps, list_drive_times
from instdrive_core.edits.queries.placement import compute_center


@pytest.fixture
def document():
    return Document(parked_street().scene)


def find(document, *ids):
    return find_overlaps(document, ids, list_drive_times(document))


def test_things_where_they_are_do_not_overlap(document):
    assert find(document, CAR, OTHER_CAR) == ()


def test_how_deep_a_car_stands_in_another_is_measured(document):
    document.apply(MoveInstances((CAR,), (0.0, 3.0, 0.0)))  # cars 4.2 m long, 3.5 m apart
    (overlap,) = find(document, CAR)
    assert (overlap.first, overlap.second, overlap.passing) == (CAR, OTHER_CAR, False)
    assert overlap.depth == pytest.approx(0.7, abs=0.15)
    assert describe_overlap(document, overlap) == f"Car 7 reaches {overlap.depth:.1f} m into Car 8"
    assert find(document, OTHER_CAR)[0].second == CAR, "asked from the other side"
    assert len(find(document, CAR, OTHER_CAR)) == 1, "a pair is told once"


@pytest.mark.parametrize("shift", [(0.0, 2.2, 0.0), (2.0, 6.5, 0.0), (0.0, 6.5, 1.7)])
def test_beside_and_above_is_not_inside(document, shift):
    document.apply(MoveInstances((CAR,), shift))
    assert find(document, CAR) == ()


def test_what_is_deleted_stands_in_nobodys_way(document):
    document.apply(DeleteInstances((OTHER_CAR,)))
    document.apply(MoveInstances((CAR,), (0.0, 6.5, 0.0)))
    assert find(document, CAR) == ()


def test_copies_count_and_walls_and_ground_do_not(document):
    document.apply(DuplicateInstances((CAR,), (0.5, 0.3, 0.0)))
    copy = max(instance.id for instance in document.scene.table)
    (overlap,) = find_overlaps(document, (copy,), [0.0], {copy})
    assert overlap.second == CAR
    document.apply(MoveInstances((CAR,), (3.5, 0.0, 0.0)))  # into the wall: a surface, 24 m long
    assert {each.second for each in find(document, CAR)} <= {copy}


def test_surfaces_that_are_moved_are_no_things(document):
    document.apply(MoveInstances((WALL,), (-4.0, 0.0, 0.0)))  # through both cars
    assert find(document, WALL) == ()


def test_a_part_of_the_scene_is_no_single_thing(document, monkeypatch):
    document.apply(MoveInstances((CAR,), (0.0, 3.0, 0.0)))
    monkeypatch.setattr("instdrive_core.edits.queries.overlaps.MOST_AT_ONCE", 1)
    assert find(document, CAR)
    assert find(document, CAR, OTHER_CAR) == ()


def test_what_training_left_inside_of_each_other_is_no_news():
    document = Document(parked_street().scene)
    rows = document.find_rows((CAR,))
    document.scene.gaussians.means[rows] += np.float32([0, 2.6, 0])
    document = Document(document.scene)
    assert find(document, CAR) == ()
    document.apply(MoveInstances((CAR,), (0.1, 0.0, 0.0)))
    assert find(document, CAR) == (), "no deeper than before"
    document.apply(MoveInstances((CAR,), (0.0, 1.5, 0.0)))
    assert [each.second for each in find(document, CAR)] == [OTHER_CAR]


def test_a_car_parked_in_the_way_of_a_driving_one_is_hit_when_it_passes():
    document = Document(procedural_street())
    track = document.scene.actors[document.scene.table[DRIVING_CAR].node - 1]
    time = float(np.mean(track.times[[0, -1]]))
    there = compute_center(document, (DRIVING_CAR,), time) - compute_center(document, (FIRST_CAR,), time)
    document.apply(MoveInstances((FIRST_CAR,), (float(there[0]), float(there[1]), 0.0)))
    hit = [each for each in find(document, FIRST_CAR) if each.second == DRIVING_CAR]
    assert len(hit) == 1
    assert hit[0].depth > 0.5
    assert track.times[0] <= hit[0].time <= track.times[-1]
