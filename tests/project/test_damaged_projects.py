"""A damaged or hostile project is refused with its name and a way on; none is taken for whole, none takes memory."""

import json
import tracemalloc
import zipfile

import numpy as np
import pytest
from document_snapshot import snapshot
from edit_cases import EXAMPLES
from project_cases import VIEW, edited_document, rewrite_json, rewrite_member
from safetensors.numpy import save

from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.project.open import open_document
from instdrive_core.project.packed_lists import LONG, pack_lists, unpack_lists
from instdrive_core.project.save import save_project


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A project's bytes, its folder, and the document it holds."""
    folder = tmp_path_factory.mktemp("whole")
    document = edited_document(folder)
    save_project(folder / "a.instdrive", document, VIEW)
    return (folder / "a.instdrive").read_bytes(), folder, snapshot(document)


@pytest.fixture
def project(whole):
    """A fresh copy beside its scene."""
    path = whole[1] / "copy.instdrive"
    path.write_bytes(whole[0])
    return path


def refused(path, match=".", error=DataError):
    with pytest.raises(error, match=match) as caught:
        open_document(path)
    assert caught.value.path == path


def test_every_truncation_is_noticed(whole, project):
    content = whole[0]
    for size in np.linspace(0, len(content) - 1, 40).astype(int):
        project.write_bytes(content[:size])
        refused(project)


def test_flipped_bytes_are_noticed_or_change_nothing(whole, project):
    content, _, expected = whole
    rng, unnoticed = np.random.default_rng(0), 0
    for place in rng.integers(0, len(content), 60).tolist():
        changed = bytearray(content)
        changed[place] ^= 1 << int(rng.integers(8))
        project.write_bytes(changed)
        try:
            document, view = open_document(project)
        except DataError:
            continue
        unnoticed += 1
        assert (snapshot(document), view) == (expected, VIEW)
    assert unnoticed < 12, "only dates, versions and attributes of the archive may change"


MANIFESTS = [
    ({"format": "zip"}, "format"),
    ({"version": 2}, "Update InstDrive"),
    ({"edits": 9}, "holds 10 edits, not 9"),
    ({"edits": 11}, "holds 10 edits, not 11"),
    ({"cursor": 11}, "beyond the 10 edits"),
    ({"cursor": -1}, "cursor"),
    ({"cursor": True}, "cursor"),
    ({"cursor": 1.5}, "cursor"),
    ({"base": None}, "sha256"),
    ({"base": {"sha256": "xyz", "size": 1, "relative": "a", "absolute": "/a"}}, "64 hexadecimal"),
    ({"base": {"sha256": "0" * 64, "size": 1, "relative": "a\0", "absolute": "/a"}}, "relative"),
    ({"base": {"sha256": "0" * 64, "size": 1, "relative": "", "absolute": ""}}, "absolute"),
    ({"inserted": []}, "inserted"),
    ({"members": ["edits.jsonl"]}, "do not agree about 'arrays/0"),
    ({"members": [1]}, "members"),
    ({"check": {}}, "splats"),
]


@pytest.mark.parametrize(("change", "match"), MANIFESTS)
def test_manifests_that_make_no_sense_are_refused(project, change, match):
    rewrite_json(project, "manifest.json", lambda manifest: manifest.update(change))
    refused(project, match)


@pytest.mark.parametrize("place", ["/dev/zero", "/", "../../../../../../etc/passwd"])
def test_scenes_that_are_no_scenes_are_refused(project, place):
    def lead_astray(manifest):
        manifest["base"] |= {"relative": place, "absolute": place}

    rewrite_json(project, "manifest.json", lead_astray)
    with pytest.raises(DataError):
        open_document(project)


MEMBERS = [
    ("edits.jsonl", lambda text: text.replace(b"insert_scene", b"format_disk"), "edit 3 of the history"),
    ("edits.jsonl", lambda text: text.replace(b'"mode"', b'"made"', 1), "edit 1 of the history"),
    ("edits.jsonl", lambda text: text.replace(b'"ids": [2]', b'"ids": [2', 1), "line 1 of edits.jsonl"),
    ("edits.jsonl", lambda text: text.replace(b'"ids": [2]', b'"ids": ' + b"[" * 100_000, 1), "nested"),
    ("edits.jsonl", lambda text: text.replace(b"[2]", b"[" + b"9" * 5000 + b"]", 1), "line 1 of edits.jsonl"),
    ("edits.jsonl", lambda text: text.replace(b"[1.0, 0.0, 0.0]", b"[NaN, 0, 0]", 1), "line 3 of edits.jsonl"),
    ("edits.jsonl", lambda text: text.replace(b"arrays/0", b"arrays/9"), "no 'arrays/9"),
    ("edits.jsonl", lambda text: text.replace(b'"arrays/0.safetensors"', b"[]"), "where an array's name should"),
    ("edits.jsonl", lambda text: b"x" * (17 << 20), "line 1 of edits.jsonl"),
    ("view.json", lambda text: b"[1]", "holds a list"),
    ("view.json", lambda text: b"{", "view.json is damaged"),
    ("arrays/0.safetensors", lambda data: data[:100], "arrays/0.safetensors"),
    ("arrays/0.safetensors", lambda data: save({"other": np.zeros(3, np.int64)}), "arrays/0.safetensors"),
    ("arrays/0.safetensors", lambda data: save({"values": np.zeros(3)}), "no list of whole numbers"),
    ("arrays/0.safetensors", lambda data: save({"values": np.zeros(10**6, np.int64)}), "at most"),
    ("arrays/0.safetensors", lambda data: save({"values": np.full((9, 2), 7)}), "edit 6 of the history"),
]


@pytest.mark.parametrize(("member", "change", "match"), MEMBERS)
def test_members_that_make_no_sense_are_refused(project, member, change, match):
    rewrite_member(project, member, change)
    refused(project, match)


@pytest.mark.parametrize("name", ["../escape", "/etc/passwd", "more.json", "arrays/../manifest.json"])
def test_members_that_no_manifest_names_are_refused_and_never_unpacked(project, name):
    with zipfile.ZipFile(project, "a") as archive:
        archive.writestr(name, "x")
    refused(project, "do not agree")
    assert not (project.parent.parent / "escape").exists()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_names_that_are_there_twice_are_refused(project):
    with zipfile.ZipFile(project, "a") as archive:
        archive.writestr("edits.jsonl", "")
    refused(project, "'edits.jsonl' twice", UntrustedDataError)


def test_odd_compression_and_no_archive_at_all_are_refused(project):
    rewrite_member(project, "view.json", lambda text: text)
    with zipfile.ZipFile(project) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(project, "w", zipfile.ZIP_BZIP2) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    refused(project, "method 12")
    project.write_bytes(b"no zip")
    refused(project, "no whole zip archive")
    project.unlink()
    refused(project, "No such file")


def test_bombs_take_no_memory(project):
    line = json.dumps({"kind": "select_none"}).encode() + b"\n"
    rewrite_member(project, "edits.jsonl", lambda text: line * (100 << 20 >> 5))
    rewrite_member(project, "arrays/0.safetensors", lambda data: b"\0" * (60 << 20))
    tracemalloc.start()
    refused(project, "would unfold", UntrustedDataError)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50 << 20
    assert project.stat().st_size < 2 << 20


# The parts


def test_long_lists_are_packed_and_come_back_equal():
    kept = []
    entry = {
        "a": list(range(LONG)),
        "b": [[k, 1] for k in range(LONG)],
        "c": [1, 2],
        "d": [[1], [2, 3]] * LONG,
        "e": [0.5] * LONG,
        "f": [2**70] * LONG,
        "g": [True] * LONG,
        "h": [{"i": tuple(range(LONG, 0, -1))}],
    }
    lean = pack_lists(entry, lambda numbers: kept.append(numbers) or len(kept) - 1)
    assert [array.shape for array in kept] == [(LONG,), (LONG, 2), (LONG,)]
    again = unpack_lists(json.loads(json.dumps(lean)), lambda number: kept[number])
    assert again == json.loads(json.dumps(entry))
    assert type(again["g"][0]) is bool


def test_json_is_bounded():
    assert parse_bounded_json(b'{"a": [1, {"b": null}]}') == {"a": [1, {"b": None}]}
    for text in (b"[" * 33 + b"]" * 33, b'{"a":' * 5000, b"[Infinity]", b"\xff", b""):
        with pytest.raises(ValueError, match=r"."):
            parse_bounded_json(text)


def test_every_edit_is_packed_to_its_json():
    long = SelectRows(np.arange(0, 5000, 2))
    kept = []
    edits = [edit_from_json({"kind": kind, **parameters}) for kind, parameters in EXAMPLES.items()]
    for edit in (*edits, long, CompoundEdit((long, long), "two")):
        lean = pack_lists(edit, lambda numbers: kept.append(numbers) or len(kept) - 1)
        again = unpack_lists(json.loads(json.dumps(lean)), lambda number: kept[number])
        assert again == json.loads(json.dumps(edit.to_json()))
    assert len(kept) >= 3
