"""What the user kept of an instance that was deleted in part, and what was missed."""

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, PAVEMENT, parked_street

from instdrive_core.edits.deletions.deletion_report import report_deletion, report_row_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteSelected
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.partial_deletion import divide_instance, is_near_deleted

CUTS = {
    "front half": lambda offsets: offsets[:, 1] > 0,
    "upper half": lambda offsets: offsets[:, 2] > 0,
    "a corner": lambda offsets: (offsets[:, 1] > 0) & (offsets[:, 2] > 0) & (offsets[:, 0] > 0),
    "both ends": lambda offsets: np.abs(offsets[:, 1]) > CAR_SIZE[1] / 4,
    "the middle": lambda offsets: np.abs(offsets[:, 1]) < CAR_SIZE[1] / 4,
}


@pytest.fixture(scope="module")
def street():
    return parked_street()


@pytest.fixture
def document(street):
    return Document(deepcopy(street.scene))


@pytest.fixture(params=CUTS)
def cut(request, document):
    """Rows of the car: those that the cut takes, and the others."""
    rows = document.find_rows((CAR,))
    taken = CUTS[request.param](document.compute_means(rows) - CAR_CENTER)
    return rows[taken], rows[~taken]


def delete(document, rows):
    document.apply(SelectRows(rows))
    document.apply(DeleteSelected())


def test_a_part_that_is_left_is_kept(document, cut):
    taken, left = cut
    remainder = divide_instance(document, CAR, taken)
    np.testing.assert_array_equal(remainder.gone, taken)
    np.testing.assert_array_equal(remainder.kept, left)
    assert not len(remainder.missed)


def test_the_part_that_is_left_is_no_residue(document, street, cut):
    taken, left = cut
    delete(document, taken)
    report = report_row_deletion(document, taken, 0.0)
    assert np.isin(left, report.residue).sum() <= 2
    assert report.carriers.keys() <= {CAR, PAVEMENT}
    assert np.isin(report.residue, [*street.strays, *left]).all()
    assert report.name == "a part of Car 7"


def test_strays_go_with_the_half_that_they_are_in(document, street):
    offsets = document.compute_means(street.strays)[:, 1] - CAR_CENTER[1]
    rows = document.find_rows((CAR,))
    taken = rows[document.compute_means(rows)[:, 1] > CAR_CENTER[1]]
    delete(document, taken)
    residue = report_row_deletion(document, taken, 0.0).residue
    assert np.isin(street.strays[offsets > 0.3], residue).all()
    assert not np.isin(street.strays[offsets < -0.3], residue).any()
    remainder = divide_instance(document, CAR, taken)
    np.testing.assert_array_equal(
        is_near_deleted(document, street.strays, remainder)[np.abs(offsets) > 0.5], (offsets > 0)[np.abs(offsets) > 0.5]
    )


@pytest.mark.parametrize("half", [False, True])
def test_single_splats_that_were_missed_are_found(document, half):
    rows = document.find_rows((CAR,))
    meant = document.compute_means(rows)[:, 1] > CAR_CENTER[1] if half else np.ones(len(rows), bool)
    missed = meant & (np.arange(len(rows)) % 20 == 0)
    found = divide_instance(document, CAR, rows[meant & ~missed])
    assert np.isin(found.missed, rows[missed]).all(), "nothing of the other half"
    assert len(found.missed) > 0.5 * np.count_nonzero(missed), "at the cut they belong to what is left"


def test_a_piece_is_kept_where_it_is_large_enough_to_be_meant(document):
    rows = document.find_rows((CAR,))
    distance = np.linalg.norm(document.compute_means(rows) - document.compute_means(rows[:1]), axis=1)
    nearest = rows[np.argsort(distance)]
    for size, kept in ((3, 0), (150, 150)):
        remainder = divide_instance(document, CAR, np.sort(nearest[size:]))
        assert len(remainder.kept) == kept
        assert len(remainder.missed) == size - kept


def test_deleted_bit_by_bit_it_is_gone_as_a_whole(document, street):
    rows = document.find_rows((CAR,))
    front = document.compute_means(rows)[:, 1] > CAR_CENTER[1]
    delete(document, rows[front])
    before = report_row_deletion(document, rows[~front], 0.0)
    delete(document, rows[~front])
    after = report_row_deletion(document, rows[~front], 0.0)
    whole = report_deletion(document, (CAR,), 0.0)
    for report in (before, after):
        assert report.name == "Car 7"
        np.testing.assert_array_equal(report.residue, street.strays)
        np.testing.assert_array_equal(report.holes[0].cells, whole.holes[0].cells)
    document.apply(after.make_absorb_edit())
    assert not len(report_deletion(document, (CAR,), 0.0).residue)


def test_nothing_left_and_nothing_taken(document):
    rows = document.find_rows((CAR,))
    everything = divide_instance(document, CAR, rows)
    assert (len(everything.gone), len(everything.kept), len(everything.missed)) == (len(rows), 0, 0)
    assert is_near_deleted(document, rows[:3], everything).all()
    nothing = divide_instance(document, CAR, rows[:0])
    assert (len(nothing.gone), len(nothing.kept), len(nothing.missed)) == (0, len(rows), 0)
