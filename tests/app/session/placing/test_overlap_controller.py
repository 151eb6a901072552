"""After a step that puts a thing into another, the user is told which, how deep and when; once."""

from procedural_street import FIRST_CAR
from session_driver import errors, finish

from instdrive_app.session.placing.settled_step import SETTLE_SECONDS
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.queries.placement import compute_center

SECOND_CAR = FIRST_CAR + 1


def settle(session):
    """Frames until what the step set off beside the window is done."""
    for _ in range(5):
        session.tick(SETTLE_SECONDS)
    finish(session)
    session.tick(0.0)


def told(session):
    return [message.text for message in session.messages.log if " reaches " in message.text]


def move_onto(session, number, other):
    document, now = session.document, session.state.time
    there = compute_center(document, (other,), now) - compute_center(document, (number,), now)
    session.history.apply(MoveInstances((number,), (float(there[0]), float(there[1]) + 1.0, 0.0)))


def test_the_overlap_of_a_moved_car_is_told_once(session):
    session.tick(0.1)
    move_onto(session, FIRST_CAR, SECOND_CAR)
    settle(session)
    settle(session)
    names = [session.document.scene.table[number].name for number in (FIRST_CAR, SECOND_CAR)]
    (text,) = told(session)
    assert text.startswith(f"{names[0]} reaches ")
    assert names[1] in text
    assert not errors(session)


def test_a_free_place_is_not_told(session):
    session.tick(0.1)
    session.history.apply(MoveInstances((FIRST_CAR,), (0.0, 0.0, 30.0)))
    settle(session)
    assert not told(session)
