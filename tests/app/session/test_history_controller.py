import pytest
from procedural_street import FIRST_CAR, procedural_street

from instdrive_app.session import history_controller
from instdrive_app.session.editor_session import EditorSession
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import fingerprint

STEPS = 10


@pytest.fixture
def session():
    session = EditorSession()
    session.show(Document(procedural_street()))
    for number in range(STEPS):
        session.colors.recolor((FIRST_CAR,), "tint", (number / STEPS, 0.5, 0.5))
    yield session
    session.close()


def test_a_long_jump_goes_on_in_the_frames_that_follow(session, monkeypatch):
    monkeypatch.setattr(history_controller, "SLICE_SECONDS", 0.0)
    document, after = session.document, fingerprint(session.document)
    session.history.jump(0)
    cursors = [document.history.cursor]
    while session.history.is_jumping:
        session.tick(0.01)
        cursors.append(document.history.cursor)
    assert cursors == [7, 4, 1, 0]
    session.history.jump(STEPS)
    while session.history.is_jumping:
        session.tick(0.01)
    assert fingerprint(document) == after


def test_nothing_is_edited_on_the_way_and_undo_ends_it(session, monkeypatch):
    monkeypatch.setattr(history_controller, "SLICE_SECONDS", 0.0)
    session.history.jump(0)
    assert not session.history.apply(lambda: pytest.fail("an edit was made"))
    assert "wait" in session.messages.log[-1].text
    session.history.undo()
    assert not session.history.is_jumping
    assert session.document.history.cursor == STEPS - 4


def test_a_short_jump_is_over_at_once(session, monkeypatch):
    monkeypatch.setattr(history_controller, "SLICE_SECONDS", 0.0)
    session.history.jump(STEPS - 3)
    assert not session.history.is_jumping
    session.history.jump(99)
    assert session.document.history.cursor == STEPS
