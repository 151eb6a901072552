"""The short form of the benchmark: a few kills, a full disk for every format, some hundred edits of all kinds."""

import os

import pytest

from benchmarks.edit_street import build_edit_street
from benchmarks.no_loss import Options, main
from benchmarks.random_edits import RandomEdits
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import fingerprint
from instdrive_core.edits.registry import EDIT_KINDS
from instdrive_core.scene.selection import Flag


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL and limits on files")
def test_nothing_is_lost(monkeypatch):
    # Where others use the cores, a thread that writes within half a second of a quiet machine may come much later.
    monkeypatch.setattr("benchmarks.no_loss.ACKNOWLEDGED_AGE", 30.0)
    monkeypatch.setattr("benchmarks.no_loss._START", 300.0)
    counts = main(Options(kills=6, autosave_span=0.5, full_disks=7, edits=80, seed=1))
    wanted = {"whole": 6, "lost": 0, "torn": 0, "stale_temporaries": 0, "full_disks_whole": 7}
    wanted |= {"replay_equal": True, "history_equal": True}
    assert {name: counts[name] for name in wanted} == wanted


def test_every_kind_of_edit_is_drawn():
    kinds = RandomEdits(Document(build_edit_street()), "absent").kinds
    assert kinds == set(EDIT_KINDS), "benchmarks/random_edits.py needs a recipe for each kind of edit"


def test_the_digest_sees_single_bits():
    document = Document(build_edit_street())
    before = fingerprint(document)
    document.state.change(document.find_rows([1])[:1], Flag.HIDDEN, True)
    assert fingerprint(document) != before
    document.state.change(document.find_rows([1])[:1], Flag.HIDDEN, False)
    assert fingerprint(document) == before
    document.scene.gaussians.means.view("u4")[7, 1] ^= 1
    assert fingerprint(document) != before
