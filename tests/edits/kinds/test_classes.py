"""The class of many instances at once."""

import pytest
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.classes import SetClass, SetInstanceClass
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.serialize import edits_from_lines, edits_to_lines
from instdrive_core.errors import EditError


@pytest.fixture
def document():
    return Document(random_scene(count=80, instances=5))


def classes_of(document):
    return {entry.id: entry.class_name for entry in document.scene.table}


def test_only_those_of_another_class_are_touched_and_come_back_as_they_were(document):
    ids = tuple(classes_of(document))
    document.apply(SetClass(ids[:1], "Bus"))
    before, entry = list(document.scene.table), document.scene.table[ids[0]]
    document.apply(SetClass(ids, "Bus"))
    assert set(classes_of(document).values()) == {"Bus"}
    assert document.scene.table[ids[0]] is entry
    document.undo()
    assert list(document.scene.table) == before
    document.redo()
    assert set(classes_of(document).values()) == {"Bus"}
    steps = document.history.cursor
    document.apply(SetClass(ids, "Bus"))
    assert document.history.cursor == steps


def test_one_edit_does_what_old_projects_did_with_many(document):
    ids = tuple(classes_of(document))
    old = CompoundEdit(
        tuple(SetInstanceClass(number, "Car") for number in ids), f"Set class of {len(ids)} instances to Car"
    )
    twin = Document(random_scene(count=80, instances=5))
    for edit in edits_from_lines(edits_to_lines([old])):
        twin.apply(edit)
    for edit in edits_from_lines(edits_to_lines([SetClass(ids, " Car ")])):
        document.apply(edit)
    assert list(twin.scene.table) == list(document.scene.table)
    assert document.history.edits[-1].title == old.title


def test_an_unknown_instance_leaves_all_as_they_are(document):
    before = list(document.scene.table)
    with pytest.raises(EditError, match="no instance 999"):
        document.apply(SetClass((*classes_of(document), 999), "Car"))
    assert list(document.scene.table) == before
