"""The history knows nothing of scenes: here its document is a list of words."""

from dataclasses import dataclass
from typing import ClassVar

import pytest

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.history import History
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.errors import EditError


@dataclass
class Say(Edit):
    kind: ClassVar[str] = "say"
    word: str

    @property
    def title(self):
        return f"Say {self.word}"

    def do(self, document):
        if self.word == "bad":
            raise EditError("no bad words")
        if not self.word:
            return False
        document.append(self.word)
        return True

    def undo(self, document):
        assert document.pop() == self.word


def test_undo_and_redo_walk_the_list():
    history, said = History(), []
    for word in "abc":
        history.apply(Say(word), said)
    assert [history.undo(said).title, history.undo(said).title] == ["Say c", "Say b"]
    assert (said, history.cursor) == (["a"], 1)
    assert history.redo(said).title == "Say b"
    assert [edit.title for edit in history.done] == ["Say a", "Say b"]
    history.apply(Say("d"), said)
    assert (said, history.redo(said)) == (["a", "b", "d"], None)
    assert [edit.title for edit in history.edits] == ["Say a", "Say b", "Say d"]


def test_nothing_to_undo_or_redo():
    history = History()
    assert history.undo([]) is None
    assert history.redo([]) is None


def test_failure_and_no_change_leave_the_history_alone():
    history, said = History(), []
    history.apply(Say("a"), said)
    history.apply(Say("b"), said)
    history.undo(said)
    with pytest.raises(EditError, match="bad"):
        history.apply(Say("bad"), said)
    history.apply(Say(""), said)
    assert (said, history.cursor, len(history.edits)) == (["a"], 1, 2)
    assert history.redo(said).title == "Say b"


def test_one_gesture_is_one_step():
    history, said = History(), []
    history.apply(Say("a"), said)
    for word in "xyz":
        history.apply(Say(word), said, gesture="drag 1")
    assert said == ["a", "z"]
    history.apply(Say("w"), said, gesture="drag 2")
    assert (said, history.cursor) == (["a", "z", "w"], 3)
    history.undo(said)
    history.apply(Say("v"), said, gesture="drag 1")
    assert said == ["a", "z", "v"], "an undo ends the gesture"


def test_gesture_that_fails_keeps_its_last_step_and_one_that_returns_to_the_start_leaves_none():
    history, said = History(), []
    history.apply(Say("x"), said, gesture="drag")
    with pytest.raises(EditError):
        history.apply(Say("bad"), said, gesture="drag")
    assert (said, history.cursor) == (["x"], 1)
    history.apply(Say("y"), said, gesture="drag")
    assert said == ["y"]
    history.apply(Say(""), said, gesture="drag")
    assert (said, history.cursor, history.edits) == ([], 0, ())


def test_compound_edits_undo_in_reverse_and_are_all_or_nothing():
    history, said = History(), []
    history.apply(CompoundEdit((Say("a"), Say(""), Say("b")), "Say both"), said)
    assert (said, history.edits[0].title) == (["a", "b"], "Say both")
    history.undo(said)
    assert said == []
    history.redo(said)
    assert said == ["a", "b"]
    with pytest.raises(EditError):
        history.apply(CompoundEdit((Say("c"), Say("bad")), "Say worse"), said)
    assert (said, history.cursor) == (["a", "b"], 1)
