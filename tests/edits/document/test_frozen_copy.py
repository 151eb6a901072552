"""Copies of a document for other threads: they stay as they are, and those made in a row share what has not changed."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR, procedural_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_colored, freeze_document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.visibility import HideInstances
from instdrive_core.scene.selection import Flag


@pytest.mark.parametrize("keeps_ids", [False, True])
def test_a_copy_stays_as_it_is(keeps_ids):
    document = Document(procedural_street())
    rows = document.find_rows((FIRST_CAR,))
    frozen = freeze_document(document, keeps_ids)
    document.apply(MergeInstances((FIRST_CAR,), FIRST_CAR + 1))
    document.apply(DeleteInstances((FIRST_CAR + 1,)))
    np.testing.assert_array_equal(frozen.find_rows((FIRST_CAR,)), rows)
    assert (frozen.scene.instance_ids[rows] == FIRST_CAR).all()
    assert FIRST_CAR in frozen.find_visible_instances()


def test_a_copy_has_moves_and_hidden_things_but_no_colours_and_may_be_edited():
    document, car = Document(procedural_street()), (FIRST_CAR,)
    rows = document.find_rows(car)
    for edit in (MoveInstances(car, (0, 1, 0)), RecolorInstances(car, "tint", (0.9, 0.4, 0.1)), DeleteInstances(car)):
        document.apply(edit)
    frozen, colored = freeze_document(document), freeze_colored(document)
    np.testing.assert_array_equal(frozen.transforms.indices, document.transforms.indices)
    np.testing.assert_array_equal(colored.colors.indices, document.colors.indices)
    assert not frozen.colors.indices.any()
    assert len(frozen.colors) == 1
    before = document.versions
    frozen.apply(RecolorInstances((FIRST_CAR + 1,), "tint", (0.1, 0.4, 0.9)))
    frozen.apply(HideInstances((FIRST_CAR + 1,)))
    assert document.versions == before
    assert not document.state.flags[document.find_rows((FIRST_CAR + 1,))].any()
    assert not freeze_document(document).colors.indices.any()
    document.undo()
    assert (frozen.state.flags[rows] == Flag.DELETED).all()


def test_copies_share_ids_until_these_change():
    document = Document(procedural_street())
    first = freeze_document(document, keeps_ids=True).scene.instance_ids
    document.apply(DeleteInstances((FIRST_CAR,)))
    assert freeze_document(document, keeps_ids=True).scene.instance_ids is first
    assert freeze_document(document).scene.instance_ids is not first, "who may write them has its own"
    document.apply(MergeInstances((FIRST_CAR + 1,), FIRST_CAR + 2))
    merged = freeze_document(document, keeps_ids=True).scene.instance_ids
    np.testing.assert_array_equal(merged, document.scene.instance_ids)
    document.undo()
    np.testing.assert_array_equal(freeze_document(document, keeps_ids=True).scene.instance_ids, first)
