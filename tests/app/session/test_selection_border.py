"""Growing and shrinking large selections beside the window: never a stale result, and in order."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR, procedural_street
from session_driver import errors, finish

from instdrive_app.session import selection_border
from instdrive_app.session.editor_session import EditorSession
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.grow import GrowSelection, ShrinkSelection
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.scene.selection import Flag


@pytest.fixture
def session(monkeypatch):
    monkeypatch.setattr(selection_border, "AT_ONCE", 0)
    session = EditorSession()
    session.show(Document(procedural_street(spacing=0.4)))
    yield session
    session.close()


def select_half(session):
    """What lies on one side of the middle: the border runs through many things."""
    x = session.document.scene.gaussians.means[:, 0]
    session.history.apply(SelectRows(np.flatnonzero(x < np.median(x))))


def selected(session):
    return session.document.state.find_rows(Flag.SELECTED)


def told(session):
    return session.messages.log[-1].text


def test_what_is_found_beside_the_window_is_what_the_edit_finds(session):
    select_half(session)
    twin = Document(procedural_street(spacing=0.4))
    for edit in (*session.document.history.edits, GrowSelection(), ShrinkSelection()):
        twin.apply(edit)
    session.selection.border.grow()
    assert session.document.history.cursor == 1
    finish(session)
    session.selection.border.shrink()
    finish(session)
    assert [edit.title for edit in session.document.history.edits[1:]] == ["Grow selection", "Shrink selection"]
    np.testing.assert_array_equal(selected(session), twin.state.find_rows(Flag.SELECTED))


def test_those_asked_for_meanwhile_follow_in_order(session):
    select_half(session)
    for name in ("grow", "grow", "shrink"):
        getattr(session.selection.border, name)()
    finish(session)
    titles = [edit.title for edit in session.document.history.edits[1:]]
    assert titles == ["Grow selection", "Grow selection", "Shrink selection"]


@pytest.mark.parametrize(
    "meanwhile",
    [
        lambda session: session.selection.select((FIRST_CAR,)),
        lambda session: session.visibility.hide((FIRST_CAR,)),
        lambda session: session.history.undo(),
    ],
    ids=["selected", "hidden", "undone"],
)
def test_what_was_found_before_an_edit_is_given_up(session, meanwhile):
    select_half(session)
    session.selection.border.grow()
    session.selection.border.grow()
    meanwhile(session)
    rows, steps = selected(session), session.document.history.cursor
    finish(session)
    np.testing.assert_array_equal(selected(session), rows)
    assert session.document.history.cursor == steps
    assert "was cancelled because the scene changed" in told(session)
    select_half(session)
    session.selection.border.grow()
    finish(session)
    assert session.document.history.edits[-1].title == "Grow selection"
    assert not errors(session)


def test_one_that_is_cancelled_does_not_stop_the_next(session):
    select_half(session)
    session.selection.border.grow()
    session.selection.border.shrink()
    session.jobs.cancel()
    finish(session)
    before = session.document.history.cursor
    session.selection.border.shrink()
    finish(session)
    assert session.document.history.cursor == before + 1


def test_a_redo_does_not_look_again(session, monkeypatch):
    select_half(session)
    session.selection.border.grow()
    finish(session)
    rows = selected(session)
    monkeypatch.setattr(GrowSelection, "search_border", lambda *_: pytest.fail("looked again"))
    session.history.undo()
    session.history.redo()
    np.testing.assert_array_equal(selected(session), rows)
