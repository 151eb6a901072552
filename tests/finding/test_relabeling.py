"""Objects found in photos become instances; what the user edited, and what has an instance, stays."""

import numpy as np
import pytest
from edit_cases import BUS, CAR, PAIR, ROAD, rich_document

from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.serialize import edits_from_lines, edits_to_lines
from instdrive_core.errors import DataError, EditError
from instdrive_core.finding.relabeling import plan_relabeling
from instdrive_core.finding.seen_objects import OBJECTS, SeenObjects, read_seen_objects, write_seen_objects


def seen(numbers, *classes):
    return SeenObjects(np.asarray(numbers, np.uint32), classes, 7, "digest")


def test_splats_without_an_instance_get_one_or_join_that_of_their_object():
    document = rich_document()
    before = document.scene.instance_ids.copy()
    free = np.flatnonzero(before == 0)
    assert len(free) > 4
    numbers = np.zeros(len(before), np.uint32)
    numbers[before == CAR] = 1
    numbers[free[:2]] = 1
    numbers[free[2:4]] = 2
    first = document.first_free_id
    document.apply(plan_relabeling(document, seen(numbers, "Car", "Bicycle"), replaces=False))
    after = document.scene.instance_ids
    assert (after[free[:2]] == CAR).all()
    assert (after[free[2:4]] == first).all()
    assert document.scene.table[first].name == f"Bicycle {first}"
    assert document.scene.table[first].class_name == "Bicycle"
    assert document.history.done[-1].title == "Find objects"
    changed = np.flatnonzero(after != before)
    assert set(changed) == set(free[:4])
    document.undo()
    np.testing.assert_array_equal(document.scene.instance_ids, before)
    assert first not in document.scene.table


def test_instances_are_replaced_where_that_is_asked_but_nothing_that_was_deleted():
    document = rich_document()
    document.apply(DeleteInstances((BUS,)))
    before = document.scene.instance_ids.copy()
    numbers = np.where(before == ROAD, 1, 2).astype(np.uint32)
    edit = plan_relabeling(document, seen(numbers, "", "Things"), replaces=True)
    document.apply(edit)
    after = document.scene.instance_ids
    assert (after[before == BUS] == BUS).all()
    assert (after[before == ROAD] == document.first_free_id - 2).all()
    assert len(np.unique(after[(before == CAR) | (before == PAIR)])) == 1
    assert CAR not in document.scene.table
    again = rich_document()
    again.apply(DeleteInstances((BUS,)))
    (read,) = edits_from_lines(edits_to_lines([edit]))
    again.apply(read)
    np.testing.assert_array_equal(again.scene.instance_ids, after)
    assert [entry.name for entry in again.scene.table] == [entry.name for entry in document.scene.table]


def test_nothing_to_do_and_another_scene_are_refused():
    document = rich_document()
    taken = (document.scene.instance_ids > 0).astype(np.uint32)
    with pytest.raises(EditError, match="belongs to an instance already"):
        plan_relabeling(document, seen(taken, "Car"), replaces=False)
    with pytest.raises(EditError, match="found in another scene"):
        plan_relabeling(document, seen(np.ones(len(taken) + 1), "Car"), replaces=True)


def test_the_file_keeps_what_was_found_and_damage_is_named(tmp_path):
    found = seen([0, 2, 1, 1], "Car", "")
    write_seen_objects(tmp_path, found)
    read = read_seen_objects(tmp_path)
    np.testing.assert_array_equal(read.numbers, found.numbers)
    assert (read.classes, read.photos, read.scene) == (("Car", ""), 7, "digest")
    write_seen_objects(tmp_path, seen([3, 0], "Car"))
    with pytest.raises(DataError, match="no objects of its list"):
        read_seen_objects(tmp_path)
    (tmp_path / OBJECTS).write_bytes(b"nothing")
    with pytest.raises(DataError, match="damaged"):
        read_seen_objects(tmp_path)
    with pytest.raises(DataError, match="no objects have been found"):
        read_seen_objects(tmp_path / "elsewhere")
