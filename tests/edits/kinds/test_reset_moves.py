"""Moves taken back."""

import numpy as np
import pytest
from random_scene import assert_same_scene, random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.edits.kinds.visibility import LockInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import EditError


def state(document):
    tracks = [track.world_from_box.tobytes() + track.dimensions.tobytes() for track in document.scene.actors]
    moves = document.transforms.matrices[document.transforms.indices]
    return moves.tobytes(), tracks, list(document.scene.table)


def test_moves_of_parked_and_driving_things_are_taken_back_to_the_bit():
    document = Document(random_scene())
    first, trained = state(document), bake_document(document)
    document.apply(MoveInstances((2,), (1.0, 2.0, 0.0), (0.9, 0.1, 0.2, 0.3), 1.5))
    document.apply(MoveInstances((2, 7), (0.0, 1.0, 0.5), scale=0.7, time=0.1))
    moved = state(document)
    document.apply(ResetMoves((2, 7)))
    assert state(document) == first
    assert_same_scene(bake_document(document), trained)
    document.undo()
    assert state(document) == moved
    document.redo()
    assert state(document) == first


def test_others_stay_where_they_were_moved_to():
    document = Document(random_scene())
    document.apply(MoveInstances((2, 3), (1.0, 0.0, 0.0)))
    document.apply(ResetMoves((2,)))
    assert not document.transforms.indices[document.find_rows((2,))].any()
    assert document.transforms.indices[document.find_rows((3,))].all()


def test_what_was_never_moved_is_no_step_and_what_is_locked_stays():
    document = Document(random_scene())
    document.apply(ResetMoves((2, 7)))
    assert document.history.cursor == 0
    document.apply(MoveInstances((2,), (1.0, 0.0, 0.0)))
    document.apply(LockInstances((2,)))
    with pytest.raises(EditError, match="unlock"):
        document.apply(ResetMoves((2,)))


def test_a_copied_drive_goes_back_to_where_it_was_copied_to():
    document = Document(random_scene())
    count = len(document.scene.actors)
    for shift in (3.0, 5.0):  # undone in between: the second copy has the first one's name
        document.apply(DuplicateInstances((7,), (0.0, shift, 0.0)))
        copy = max(entry.id for entry in document.scene.table)
        copied = document.scene.actors[count].world_from_box.copy()
        document.apply(MoveInstances((copy,), (1.0, 0.0, 0.0)))
        document.apply(ResetMoves((copy,)))
        np.testing.assert_array_equal(document.scene.actors[count].world_from_box, copied)
        for _ in range(3):
            document.undo()
