"""Every kind of edit in the registry: its record, its JSON, and that undo and redo give every bit again."""

import json
import re
from pathlib import Path

import pytest
from document_snapshot import snapshot
from edit_cases import EXAMPLES, rich_document
from imgui_bundle import icons_fontawesome_6

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.invariants import find_broken_invariants
from instdrive_core.edits.registry import EDIT_KINDS
from instdrive_core.edits.serialize import edit_from_json

ROOT = Path(__file__).resolve().parents[2]


def test_every_edit_class_has_a_record_and_an_example():
    def find_descendants(cls):
        return {cls} | {sub for child in cls.__subclasses__() for sub in find_descendants(child)}

    found = {
        cls for cls in find_descendants(Edit) if not cls.__abstractmethods__ and "instdrive_core" in cls.__module__
    }
    assert {kind.edit for kind in EDIT_KINDS.values()} == found
    assert EXAMPLES.keys() == EDIT_KINDS.keys()


@pytest.mark.parametrize("kind", EDIT_KINDS.values(), ids=EDIT_KINDS.keys())
def test_records_are_whole(kind):
    assert hasattr(icons_fontawesome_6, kind.icon)
    assert kind.edit.__doc__
    assert set(EXAMPLES[kind.name]) <= set(kind.parameters)


@pytest.mark.parametrize("kind", [kind for kind in EDIT_KINDS.values() if kind.is_old], ids=lambda kind: kind.name)
def test_old_kinds_are_read_and_never_made(kind):
    making = re.compile(rf"\b{kind.edit.__name__}\(")
    sources = [path for folder in ("app", "instdrive_core", "examples") for path in (ROOT / folder).rglob("*.py")]
    assert [path.stem for path in sources if making.search(path.read_text(encoding="utf-8"))] == [
        kind.edit.__module__.rsplit(".", 1)[1]
    ], "only its own class statement names it so"


@pytest.mark.parametrize("name", EDIT_KINDS)
def test_an_edit_is_done_undone_redone_and_replayed_bit_by_bit(name):
    document, other = rich_document(), rich_document()
    before, cursor = snapshot(document), document.history.cursor
    versions = document.versions
    assert snapshot(other) == before
    edit = edit_from_json({"kind": name, **EXAMPLES[name]})
    document.apply(edit)
    after = snapshot(document)
    assert document.history.cursor == cursor + 1, "the example changes the document"
    assert after != before
    assert document.versions != versions
    assert edit.title
    assert "\n" not in edit.title
    assert find_broken_invariants(document) == []
    changed = {part for part in before if before[part] != after[part]}
    assert not EDIT_KINDS[name].selects_only or changed == {"VISIBILITY"}
    document.undo()
    assert snapshot(document) == before
    document.redo()
    assert snapshot(document) == after
    again = edit_from_json(json.loads(json.dumps(edit.to_json())))
    assert again == edit
    assert again.to_json() == edit.to_json()
    other.apply(again)
    assert snapshot(other) == after
    while document.undo():
        pass
    assert find_broken_invariants(document) == []
