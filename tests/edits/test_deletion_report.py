"""What a deletion leaves: strays under other labels, and ground that only the deleted car ever covered."""

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, OTHER_CAR, PAVEMENT, ROAD, parked_street
from random_scene import random_scene

from instdrive_core.edits.delete import DeleteInstances, DeleteSelected
from instdrive_core.edits.deletion_report import deletion_report, deletion_report_of_rows, deletion_survey
from instdrive_core.edits.document import Document
from instdrive_core.edits.select_rows import SelectRows
from instdrive_core.edits.visibility import LockInstances
from instdrive_core.errors import EditError
from instdrive_core.scene.selection import Flag


def under_car(hole):
    """How many of a hole's cells lie in the footprint of the car, and how many do not."""
    inside = (np.abs(hole.grid.centers(hole.cells) - CAR_CENTER[:2]) <= CAR_SIZE[:2] / 2).all(axis=1)
    return np.count_nonzero(inside), np.count_nonzero(~inside)


@pytest.fixture(scope="module")
def street():
    return parked_street()


def test_strays_and_the_ground_never_seen_are_reported(street):
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((CAR,)))
    report = deletion_report(document, (CAR,), 0.0)
    np.testing.assert_array_equal(report.residue, street.strays)
    assert report.carriers == {PAVEMENT: len(street.strays)}
    inside, outside = under_car(report.hole)
    assert inside * report.hole.grid.size**2 == pytest.approx(CAR_SIZE[0] * CAR_SIZE[1], rel=0.1)
    assert outside < 0.25 * inside
    assert report.summary == f"40 splats of residue, hole of {report.hole_area:.1f} m²"
    assert report.name == "Car 7"
    corners = report.hole.outlines
    np.testing.assert_allclose(corners[..., 2], 0.02 * corners[..., 1], atol=0.02)


def test_a_report_before_the_deletion_is_that_of_after(street):
    document = Document(deepcopy(street.scene))
    before = deletion_report(document, (CAR,), 0.0)
    document.apply(DeleteInstances((CAR,)))
    after = deletion_report(document, (CAR,), 0.0)
    np.testing.assert_array_equal(before.residue, after.residue)
    np.testing.assert_array_equal(before.hole.cells, after.hole.cells)


def test_ground_that_is_there_is_no_hole(street):
    """Photos cannot have shown it, yet it looks like the ground around it."""
    document = Document(deepcopy(street.empty))
    document.apply(DeleteInstances((OTHER_CAR,)))
    report = deletion_report(document, (OTHER_CAR,), 0.0)
    assert report.hole_area == 0
    assert report.filling() is None
    assert report.absorption() is None
    assert report.summary == "no residue, no hole"


def test_without_photos_the_footprint_is_what_may_be_missing():
    street = parked_street(views=False)
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((CAR,)))
    inside, outside = under_car(deletion_report(document, (CAR,), 0.0).hole)
    assert inside > 150
    assert outside < 0.3 * inside


def test_absorbing_empties_the_residue(street):
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((CAR,)))
    report = deletion_report(document, (CAR,), 0.0)
    flags = document.state.flags.copy()
    document.apply(report.absorption())
    assert not len(deletion_report(document, (CAR,), 0.0).residue)
    assert document.state.mask(Flag.DELETED)[street.strays].all()
    document.undo()
    np.testing.assert_array_equal(document.state.flags, flags)
    np.testing.assert_array_equal(deletion_report(document, (CAR,), 0.0).residue, report.residue)


def test_a_lassoed_car_leaves_what_the_lasso_missed(street):
    document = Document(deepcopy(street.scene))
    members = document.rows_of((CAR,))
    missed = members[::20]
    rows = np.setdiff1d(members, missed)
    document.apply(SelectRows(rows))
    document.apply(DeleteSelected())
    report = deletion_report_of_rows(document, rows, 0.0)
    assert np.isin(street.strays, report.residue).all()
    assert np.isin(missed, report.residue).mean() > 0.5
    assert set(report.carriers) == {CAR, PAVEMENT}
    assert report.hole_area == pytest.approx(CAR_SIZE[0] * CAR_SIZE[1], rel=0.3)
    document.apply(report.absorption())
    assert not np.isin(report.residue, deletion_report_of_rows(document, rows, 0.0).residue).any()
    assert document.state.mask(Flag.DELETED)[report.residue].all()


def test_locked_strays_are_spared(street):
    document = Document(deepcopy(street.scene))
    document.apply(LockInstances((PAVEMENT,)))
    document.apply(DeleteInstances((CAR,)))
    assert not len(deletion_report(document, (CAR,), 0.0).residue)


def test_surfaces_and_moving_objects_leave_no_hole(street):
    document = Document(deepcopy(street.scene))
    report = deletion_report(document, (ROAD,), 0.0)
    assert (len(report.residue), report.hole) == (0, None)
    driving = Document(random_scene())
    report = deletion_report(driving, (7, 8), 0.2)
    assert report.name == "2 instances"
    assert report.hole_area == 0
    with pytest.raises(EditError, match="no instance 99"):
        deletion_report(document, (99,), 0.0)


def test_a_survey_does_not_follow_the_document(street):
    document = Document(deepcopy(street.scene))
    expected = deletion_report(document, (CAR,), 0.0)
    survey = deletion_survey(document, (CAR,), 0.0)
    document.apply(DeleteInstances((ROAD, PAVEMENT)))
    late = survey.report()
    np.testing.assert_array_equal(late.hole.cells, expected.hole.cells)
