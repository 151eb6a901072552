"""What photos say about a deleted car: a record of them says the same to the last bit whatever was deleted since."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from parked_street import CAR, parked_street

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import fingerprint
from instdrive_core.edits.holes.photo_evidence import CLOSE, gather_photo_evidence
from instdrive_core.edits.holes.photo_sights import PhotographedSplats
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteSelected
from instdrive_core.edits.kinds.select_rows import SelectRows


@pytest.fixture(scope="module")
def street():
    return parked_street()


def delete_rows(document, rows):
    document.apply(SelectRows(rows))
    document.apply(DeleteSelected())


def same(one, other):
    for name in ("unseen", "seen", "explained"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert len(one.looks) == len(other.looks)
    for look, twin in zip(one.looks, other.looks, strict=True):
        np.testing.assert_array_equal(look.silhouette, twin.silhouette)
        np.testing.assert_array_equal(look.open, twin.open)
        assert look.nearest == twin.nearest
    return True


@pytest.mark.parametrize("filled", [False, True])
def test_a_record_says_the_same_once_other_things_are_deleted(street, filled, monkeypatch):
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((CAR,)))
    if filled:  # what lies there now was in no photo
        document.apply(report_deletion(document, (CAR,), 0.0).make_fill_edits()[0])
    group = [document.find_rows((CAR,))]
    before = gather_photo_evidence(document, group)
    behind = np.concatenate([np.unique(sight.behind.rows) for sight in before.record.sights])
    delete_rows(document, np.unique(np.concatenate([street.strays, behind[::3]])))
    fresh = gather_photo_evidence(document, group)
    assert any(np.any(old.open != new.open) for old, new in zip(before.looks, fresh.looks, strict=True))
    monkeypatch.setattr(PhotographedSplats, "look", None)
    assert same(gather_photo_evidence(document, group, record=before.record), fresh)


def test_a_record_of_something_else_is_not_used(street):
    document = Document(deepcopy(street.scene))
    rows = document.find_rows((CAR,))
    half = gather_photo_evidence(document, [rows[::2]])
    assert same(gather_photo_evidence(document, [rows], record=half.record), gather_photo_evidence(document, [rows]))
    document.scene.gaussians.means[rows] += 0.2
    assert gather_photo_evidence(document, [rows], record=half.record).record is not half.record


def delete_and_fill(scene, forget):
    document = Document(deepcopy(scene))
    document.apply(DeleteInstances((CAR,)))
    report = report_deletion(document, (CAR,), 0.0)
    document.apply(report.make_absorb_edit())
    edit = report.make_fill_edits()[0]
    if forget:
        edit.remember(None)
    document.apply(edit)
    return document


def test_a_fill_is_the_same_with_what_the_report_saw_and_without(street):
    one, other = (delete_and_fill(street.scene, forget) for forget in (False, True))
    assert fingerprint(one) == fingerprint(other)


def test_what_one_photo_reached_stays_unless_it_lies_close_to_the_thing(street):
    scene = deepcopy(street.scene)
    views = [view for view in scene.views if gather_one(scene, view) is not None]
    told = {False: 0, True: 0}
    for view in views[::2]:
        found = gather_one(scene, view)
        (sight,) = found.record.sights
        hidden = np.bincount(sight.behind.rows, sight.behind.weights, len(scene))[sight.rows]
        reached = sight.rows[(sight.beside > 1) & (sight.beside > 2 * hidden) & (hidden > 1)]
        car = scene.gaussians.means[scene.instance_ids == CAR]
        away = np.linalg.norm(scene.gaussians.means[reached][:, None] - car[None], axis=2).min(axis=1)
        for far in (False, True):
            rows = reached[away > CLOSE + 0.2] if far else reached[away < CLOSE - 0.2]
            told[far] += len(rows)
            assert np.isin(rows, found.unseen).mean() == (0 if far else 1) if len(rows) else True
    assert told[True] > 5
    assert told[False] > 5


def gather_one(scene, view):
    document = Document(replace(scene, views=(view,)))
    return gather_photo_evidence(document, [document.find_rows((CAR,))])
