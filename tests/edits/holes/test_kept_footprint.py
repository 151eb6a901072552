"""The ground under what was kept of a car is no hole."""

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, parked_street

from instdrive_core.edits.deletions.deletion_report import report_deletion, report_row_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.kept_footprint import find_kept_footprint
from instdrive_core.edits.kinds.delete import DeleteSelected
from instdrive_core.edits.kinds.select_rows import SelectRows

LENGTH = CAR_SIZE[1]
UNCOVERED = {
    "upper half": (lambda offsets: offsets[:, 2] > 0, 0.0),
    "a corner": (lambda offsets: (offsets > 0).all(axis=1), 0.0),
    "front half": (lambda offsets: offsets[:, 1] > 0, 0.5),
    "the middle": (lambda offsets: np.abs(offsets[:, 1]) < LENGTH / 4, 0.5),
    "all but the roof": (lambda offsets: offsets[:, 2] < 0.6 * CAR_SIZE[2] / 2, 1.0),
}
GRID = GroundGrid((-5.0, -5.0), (1.0, 0.0), 0.2, (50, 50), (0.0, 0.0, 0.0))


@pytest.fixture(scope="module", params=[True, False], ids=["photos", "no photos"])
def street(request):
    return parked_street(views=request.param)


@pytest.mark.parametrize("cut", UNCOVERED)
def test_only_what_the_deleted_part_stood_on_is_a_hole(street, cut):
    document = Document(deepcopy(street.scene))
    whole = under_car(report_deletion(document, (CAR,), 0.0))
    takes, share = UNCOVERED[cut]
    rows = document.find_rows((CAR,))
    offsets = document.compute_means(rows) - CAR_CENTER - [0, 0, 0.02 * CAR_CENTER[1]]
    deleted = rows[takes(offsets)]
    before = report_row_deletion(document, deleted, 0.0)
    document.apply(SelectRows(deleted))
    document.apply(DeleteSelected())
    report = report_row_deletion(document, deleted, 0.0)
    assert under_car(report) == pytest.approx(share * whole, abs=0.25 * whole if share else 0.01)
    assert report.hole_area == before.hole_area, "what is reported before a deletion is what is found after it"


def under_car(report):
    """Square metres of the hole under the car; what it hid behind itself does not count."""
    area = 0.0
    for hole in report.holes:
        away = np.abs(hole.grid.compute_centers(hole.cells) - CAR_CENTER[:2])
        area += np.count_nonzero((away < CAR_SIZE[:2] / 2).all(axis=1)) * hole.grid.size**2
    return area


def box(low, high, count=400, seed=0):
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


def test_pieces_are_covered_one_by_one_and_only_where_they_stand():
    front, back = box([-2, -1, 0], [-1, 1, 1]), box([1, -1, 0], [2, 1, 1])
    under = find_kept_footprint([np.concatenate([front, back])], GRID)
    places = GRID.compute_centers(np.argwhere(under))
    assert np.count_nonzero(under) * GRID.size**2 == pytest.approx(4.0, rel=0.35)
    assert (np.abs(places[:, 0]) > 0.8).all(), "nothing stands between the pieces"
    floating = box([-2, -1, 0.6], [2, 1, 0.9])
    assert not find_kept_footprint([floating], GRID).any()
    assert not find_kept_footprint([box([-2, -1, 1.2], [2, 1, 1.5]), np.zeros((0, 3))], GRID).any()


def test_scraps_without_an_outline_cover_their_own_cells():
    assert np.count_nonzero(find_kept_footprint([np.array([[0.1, 0.1, 0.1]])], GRID)) == 1
    row = np.c_[np.linspace(-1, 1, 30), np.full(30, 0.1), np.full(30, 0.1)]
    assert np.count_nonzero(find_kept_footprint([row], GRID)) >= 10
    assert not find_kept_footprint([np.array([[900.0, 0.1, 0.1]])], GRID).any()
