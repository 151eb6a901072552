"""Bounds that wait after a move of very many instances: exact before anything else is done."""

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_app.session.selection_box import SelectionBoxes
from instdrive_core.edits.bases import poses
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import fingerprint
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.errors import EditError

IDS = (1, 2, 3, 4)
TURN = (0.9, 0.1, 0.2, -0.4)


@pytest.fixture(autouse=True)
def few_are_many(monkeypatch):
    monkeypatch.setattr(poses, "MANY", 1)


def fresh(waits=True):
    document = Document(random_scene(count=400, instances=6, actors=1))
    document.can_defer_bounds = waits
    return document


def digest_of(*steps):
    """What a document whose bounds never wait holds after these steps."""
    exact = fresh(waits=False)
    for step in steps:
        step(exact)
    return fingerprint(exact)


def move(shift=1.0, ids=IDS):
    return MoveInstances(ids, (shift, 0.2, 0.0), TURN, 1.1, (0.0, 0.0, 0.0))


def test_bounds_become_exact_bit_by_bit_some_at_a_time():
    document = fresh()
    before = list(document.scene.table)
    document.apply(move())
    assert list(document.scene.table) == before
    calls = 0
    while document.deferred is not None:
        document.run_deferred(50)
        calls += 1
    assert 1 < calls <= len(IDS)
    assert fingerprint(document) == digest_of(lambda exact: exact.apply(move()))


def test_a_box_around_them_goes_along():
    document = fresh()
    boxes = SelectionBoxes()
    still = tuple(number for number in IDS if not document.scene.table[number].node)
    before = boxes.find_box(document, still, 0.0)
    edit = MoveInstances(still, (5.0, -2.0, 1.0))
    document.apply(edit)
    assert document.deferred is not None
    along = boxes.find_box(document, still, 0.0)
    np.testing.assert_allclose(along.center, before.center + np.array([5.0, -2.0, 1.0]), atol=1e-6)
    document.run_deferred()
    np.testing.assert_allclose(boxes.find_box(document, still, 0.0).center, along.center, atol=1e-5)
    document.apply(MoveInstances(still, (1.0, 0.0, 0.0), TURN, 1.2))
    turned = boxes.find_box(document, still, 0.0)
    document.run_deferred()
    exact = boxes.find_box(document, still, 0.0)
    assert (turned.corners.min(axis=0) <= exact.corners.min(axis=0) + 1e-4).all()
    assert (turned.corners.max(axis=0) >= exact.corners.max(axis=0) - 1e-4).all()


@pytest.mark.parametrize("caught_up", [0, 60, None])
@pytest.mark.parametrize(
    "following",
    [
        lambda document: document.apply(move(2.0)),
        lambda document: document.apply(move(2.0), "drag"),
        lambda document: document.apply(MoveInstances(IDS), "drag"),
        lambda document: document.apply(SelectInstances((2,))),
        lambda document: document.apply(ResetMoves(IDS)),
        lambda document: document.undo(),
        lambda document: [document.undo(), document.redo()],
        lambda document: [document.undo(), document.redo(), document.undo(), document.redo()],
        lambda document: document.apply(CompoundEdit((move(0.5), SelectInstances((1,)), move(3.0)), "both")),
    ],
)
def test_whatever_follows_sees_exact_bounds(following, caught_up):
    document = fresh()

    def drag(document):
        for shift in (0.1, 0.2, 0.3):
            document.apply(move(shift), "drag")

    drag(document)
    if caught_up is None:
        document.run_deferred()
    elif caught_up:
        document.run_deferred(caught_up)
    following(document)
    document.run_deferred()
    assert document.deferred is None
    assert fingerprint(document) == digest_of(drag, following)
    while document.undo():
        pass
    document.run_deferred()
    assert fingerprint(document) == digest_of()


def test_an_edit_that_fails_leaves_exact_bounds():
    document = fresh()
    document.apply(move(), "drag")
    with pytest.raises(EditError):
        document.apply(move(ids=(1, 999)), "drag")
    document.run_deferred()
    assert fingerprint(document) == digest_of(lambda exact: exact.apply(move()))


def test_a_part_of_another_edit_and_a_document_without_frames_do_not_wait():
    document = fresh()
    document.apply(CompoundEdit((move(), move(2.0)), "both"))
    assert document.deferred is None
    document = fresh(waits=False)
    document.apply(move())
    assert document.deferred is None


def test_a_frozen_copy_is_exact():
    document = fresh()
    document.apply(move())
    assert list(freeze_document(document).scene.table) == list(document.scene.table)
    assert document.deferred is None
