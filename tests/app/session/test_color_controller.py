"""Recolouring without a window: vehicles are painted, C only asks, and the settings of paint reach what is painted."""

import numpy as np
from procedural_street import FIRST_CAR, HOUSES


def test_vehicles_are_painted_and_the_rest_tinted_until_the_user_chooses(session):
    table = session.document.scene.table
    assert table[FIRST_CAR].name
    session.labels.set_class((FIRST_CAR,), "Car")
    assert session.colors.find_mode((FIRST_CAR,)) == "paint"
    assert session.colors.find_mode((FIRST_CAR, HOUSES)) == "tint"
    session.colors.mode = "solid"
    assert session.colors.find_mode((FIRST_CAR,)) == "solid"


def test_the_key_asks_for_a_colour_and_changes_nothing(session):
    session.selection.select((FIRST_CAR,))
    before = len(session.document.history.edits)
    assert session.actions.run("edit.recolor")
    assert len(session.document.history.edits) == before
    assert [session.colors.take_question() for _ in range(10)].count(True) == 1


def test_tolerance_and_reference_paint_again_what_was_painted_last(session):
    session.selection.select((FIRST_CAR,))
    session.colors.recolor((FIRST_CAR,), "paint", (0.1, 0.7, 0.2))
    document = session.document
    rows = document.find_rows((FIRST_CAR,))

    def count_painted():
        return int((document.colors.matrices[document.colors.indices[rows]] != np.eye(3, 4)).any((1, 2)).sum())

    some = count_painted()
    session.colors.set_tolerance((FIRST_CAR,), 1.0, "drag 1")
    assert count_painted() == len(rows) > some > 0
    session.colors.picks_reference = True
    session.colors.tolerance = 0.05
    session.colors.take_reference_from(int(rows[0]))
    assert not session.colors.picks_reference
    assert 0 < count_painted() < len(rows)
    assert document.history.done[-1].reference is not None
