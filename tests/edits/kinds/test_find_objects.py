"""Finding objects labels what has no instance, can be prepared ahead, and says why it finds nothing."""

import numpy as np
import pytest
from edit_cases import CAR, rich_document

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.find_objects import FindObjects
from instdrive_core.errors import EditError
from instdrive_core.instances.table import InstanceTable


def bare_document():
    scene = rich_document().scene
    scene.instance_ids = np.zeros(len(scene), np.uint32)
    scene.table = InstanceTable()
    return Document(scene)


def test_moving_objects_and_what_stands_become_instances():
    document, truth = bare_document(), rich_document().scene
    edit = FindObjects(gap=0.5, unit=1.0)
    count = edit.prepare(freeze_document(document))
    assert edit.is_prepared_for(document)
    document.apply(edit)
    assert len(document.scene.table) == count
    assert [entry.node for entry in document.scene.table][-2:] == [1, 2]
    ids = document.scene.instance_ids
    cars = ids[(truth.instance_ids == CAR)]
    assert np.bincount(cars).argmax() > 0
    assert np.mean(cars == np.bincount(cars).argmax()) > 0.9
    assert sum(entry.count for entry in document.scene.table) == np.count_nonzero(ids)
    document.undo()
    assert not document.scene.instance_ids.any()
    assert len(document.scene.table) == 0


def test_instances_and_deleted_splats_are_left_alone():
    document = rich_document()
    before = document.scene.instance_ids.copy()
    document.apply(FindObjects(gap=0.5))
    assert (document.scene.instance_ids[before > 0] == before[before > 0]).all()
    assert (document.scene.instance_ids != before).any()
    new = max(entry.id for entry in document.scene.table)
    document.apply(DeleteInstances((new,)))
    with pytest.raises(EditError, match="upright"):
        document.apply(FindObjects(gap=0.5))


@pytest.mark.parametrize("parameters", [{"gap": 0}, {"gap": True}, {"longest": float("inf")}, {"unit": -1}])
def test_numbers_must_be_lengths(parameters):
    with pytest.raises(EditError, match="is not a number above 0"):
        FindObjects(**parameters)
