"""The history knows nothing of scenes: here its document holds words."""

from dataclasses import dataclass
from typing import ClassVar

import pytest

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.history import History
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.errors import EditError


class Words(Document):
    def __init__(self):
        self.said = []


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
        document.said.append(self.word)
        return True

    def undo(self, document):
        assert document.said.pop() == self.word


def test_undo_and_redo_walk_the_list():
    history, document = History(), Words()
    for word in "abc":
        history.apply(Say(word), document)
    assert [history.undo(document).title, history.undo(document).title] == ["Say c", "Say b"]
    assert (document.said, history.cursor) == (["a"], 1)
    assert history.redo(document).title == "Say b"
    assert [edit.title for edit in history.done] == ["Say a", "Say b"]
    history.apply(Say("d"), document)
    assert (document.said, history.redo(document)) == (["a", "b", "d"], None)
    assert [edit.title for edit in history.edits] == ["Say a", "Say b", "Say d"]


def test_nothing_to_undo_or_redo():
    history = History()
    assert history.undo(Words()) is None
    assert history.redo(Words()) is None


def test_failure_and_no_change_leave_the_history_alone():
    history, document = History(), Words()
    history.apply(Say("a"), document)
    history.apply(Say("b"), document)
    history.undo(document)
    with pytest.raises(EditError, match="bad"):
        history.apply(Say("bad"), document)
    history.apply(Say(""), document)
    assert (document.said, history.cursor, len(history.edits)) == (["a"], 1, 2)
    assert history.redo(document).title == "Say b"


def test_one_gesture_is_one_step():
    history, document = History(), Words()
    history.apply(Say("a"), document)
    for word in "xyz":
        history.apply(Say(word), document, gesture="drag 1")
    assert document.said == ["a", "z"]
    history.apply(Say("w"), document, gesture="drag 2")
    assert (document.said, history.cursor) == (["a", "z", "w"], 3)
    history.undo(document)
    history.apply(Say("v"), document, gesture="drag 1")
    assert document.said == ["a", "z", "v"], "an undo ends the gesture"


def test_gesture_that_fails_keeps_its_last_step_and_one_that_returns_to_the_start_leaves_none():
    history, document = History(), Words()
    history.apply(Say("x"), document, gesture="drag")
    with pytest.raises(EditError):
        history.apply(Say("bad"), document, gesture="drag")
    assert (document.said, history.cursor) == (["x"], 1)
    history.apply(Say("y"), document, gesture="drag")
    assert document.said == ["y"]
    history.apply(Say(""), document, gesture="drag")
    assert (document.said, history.cursor, history.edits) == ([], 0, ())


def test_compound_edits_undo_in_reverse_and_are_all_or_nothing():
    history, document = History(), Words()
    history.apply(CompoundEdit((Say("a"), Say(""), Say("b")), "Say both"), document)
    assert (document.said, history.edits[0].title) == (["a", "b"], "Say both")
    history.undo(document)
    assert document.said == []
    history.redo(document)
    assert document.said == ["a", "b"]
    with pytest.raises(EditError):
        history.apply(CompoundEdit((Say("c"), Say("bad")), "Say worse"), document)
    assert (document.said, history.cursor) == (["a", "b"], 1)


def test_the_last_edit_can_grow_without_being_done_again():
    history, document = History(), Words()
    history.apply(Say("a"), document)
    history.apply(Say("b"), document, "a drag")
    history.extend_last(CompoundEdit.extend(history.done[-1], (Say("c"), Say(""))), document)
    assert (document.said, [edit.title for edit in history.done]) == (["a", "b", "c"], ["Say a", "Say b"])
    history.extend_last(CompoundEdit.extend(history.done[-1], (Say("d"),)), document)
    assert document.said == ["a", "b", "c", "d"]
    history.undo(document)
    assert document.said == ["a"]
    history.redo(document)
    assert document.said == ["a", "b", "c", "d"]
    history.undo(document)
    history.redo(document)
    assert document.said == ["a", "b", "c", "d"]
    history.apply(Say("e"), document, "a drag")
    assert document.said == ["a", "b", "c", "d", "e"], "another drag, as undo has ended the first one"
    history.extend_last(CompoundEdit.extend(history.done[-1], (Say("f"),)), document)
    history.apply(Say("g"), document, "a drag")
    assert document.said == ["a", "b", "c", "d", "g"], "the drag goes on, and replaces what was added to it"


def test_an_edit_that_cannot_go_on_leaves_the_last_one():
    history, document = History(), Words()
    with pytest.raises(ValueError, match="only the last edit"):
        history.extend_last(CompoundEdit.extend(Say("a"), ()), document)
    history.apply(Say("a"), document)
    with pytest.raises(EditError):
        history.extend_last(CompoundEdit.extend(history.done[-1], (Say("b"), Say("bad"))), document)
    assert (document.said, history.cursor, history.done[-1].title) == (["a"], 1, "Say a")
    history.apply(Say("b"), document)
    assert document.said == ["a", "b"]
    history.undo(document)
    with pytest.raises(ValueError, match="only the last edit"):
        history.extend_last(CompoundEdit.extend(Say("a"), ()), document)
