"""What is deleted together leaves one hole where it stood close together, and one each where it did not."""

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, OTHER_CAR, ROAD, WALL, parked_street

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.deletions.prepared_fill import prepare_fills
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.deleted_neighbors import find_deleted_neighbors, group_neighbors
from instdrive_core.edits.holes.ground_cells import find_covered_cells
from instdrive_core.edits.holes.holes import build_ground_grid, find_known_ground
from instdrive_core.edits.holes.surroundings import find_surroundings
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.track import Track

RED = (0.9, 0.05, 0.05)
OTHER_CENTER = CAR_CENTER + np.array([0, 6.5, 0])


def street_with_gap(gap=2.3, views=True):
    """The street with the other car `gap` metres behind the car, and red noise where that one stands."""
    scene = deepcopy(parked_street(views=views).scene)
    means = scene.gaussians.means
    shift = gap - (6.5 - CAR_SIZE[1])
    means[scene.instance_ids == OTHER_CAR] += np.float32([0, shift, 0.02 * shift])
    center = OTHER_CENTER + np.array([0, shift, 0])
    ground = np.isin(scene.instance_ids, (ROAD, 2))
    under = ground & (np.abs(means[:, :2] - center[:2]) < CAR_SIZE[:2] / 2).all(axis=1)
    scene.gaussians.sh_dc[under] = dc_from_color(np.float32(RED))
    scene.table = build_instance_table(
        scene.instance_ids, means, scene.codewords, None, {each.id: each.name for each in scene.table}, {}
    )
    return scene


def members(document, *numbers):
    return [(number, document.find_rows((number,))) for number in numbers]


@pytest.mark.parametrize(("gap", "groups"), [(2.3, [[0, 1]]), (3.5, [[0, 1]]), (4.5, [[0], [1]])])
def test_things_are_joined_as_long_as_they_fit_on_one_map(gap, groups):
    document = Document(street_with_gap(gap))
    assert group_neighbors(document, members(document, CAR, OTHER_CAR), 0.0) == groups


def test_surfaces_join_the_only_group_or_make_one_of_their_own():
    document = Document(street_with_gap())
    assert group_neighbors(document, members(document, WALL, CAR, ROAD), 0.0) == [[0], [1, 2]], "a wall is alone"
    document = Document(street_with_gap(5.0))
    assert group_neighbors(document, members(document, CAR, WALL, OTHER_CAR), 0.0) == [[0], [1], [2]]
    assert group_neighbors(document, [], 0.0) == []


def test_what_moves_is_alone():
    scene = street_with_gap()
    rows = np.flatnonzero(scene.instance_ids == OTHER_CAR)
    middle = scene.gaussians.means[rows].mean(axis=0)
    scene.gaussians.means[rows] -= middle
    scene.nodes[rows] = 1
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 3] = middle
    scene.actors = (Track("car", "Car", CAR_SIZE, np.array([0.0, 2.0]), poses),)
    document = Document(scene)
    assert group_neighbors(document, members(document, CAR, OTHER_CAR), 0.0) == [[0], [1]]


def test_things_far_apart_leave_a_hole_each_that_lies_under_them():
    document = Document(street_with_gap(5.0))
    document.apply(DeleteInstances((CAR, OTHER_CAR)))
    report = report_deletion(document, (CAR, OTHER_CAR), 0.0)
    assert report.name == "2 instances"
    assert [each.name for each in report.clearings] == ["Car 7", "Car 8"]
    assert report.summary.endswith(f"2 holes of {report.hole_area:.1f} m²")
    assert [hole.beside for hole in report.holes] == [(OTHER_CAR,), (CAR,)]
    borders = [hole.grid.compute_centers(hole.cells)[:, 1] for hole in report.holes]
    middle = CAR_CENTER[1] + (CAR_SIZE[1] + 5.0) / 2
    assert borders[0].max() < middle + 0.2, "ground belongs to the nearest of them"
    assert borders[1].min() > middle - 0.2


def test_below_the_next_deleted_car_no_ground_is_known():
    """Photos showed it as little as what lies in the hole itself."""
    document = Document(street_with_gap(5.0))
    document.apply(DeleteInstances((CAR, OTHER_CAR)))
    found = find_surroundings(document, members(document, CAR), 0.0)
    grid = build_ground_grid(found)
    beside = find_deleted_neighbors(document, found.place, (CAR,), {})
    hole = find_covered_cells(found.deleted, grid)
    under = find_covered_cells(beside, grid)
    shares = [find_known_ground(document, grid, found.around, hole, others)[1][under].mean() for others in ((), beside)]
    assert shares[0] > 0.5, "nobody says that a car stood there"
    assert shares[1] == 0


def test_a_filled_place_counts_as_ground_again():
    document = Document(street_with_gap(5.0))
    document.apply(DeleteInstances((CAR, OTHER_CAR)))
    beside = [each.body.instance for each in find_deleted_neighbors(document, CAR_CENTER, (CAR,), {})]
    assert beside == [OTHER_CAR]
    document.apply(report_deletion(document, (OTHER_CAR,), 0.0).make_fill_edits()[0])
    assert find_deleted_neighbors(document, CAR_CENTER, (CAR,), {}) == ()


def test_what_is_worked_out_beside_the_document_is_done_as_one_step():
    document = Document(street_with_gap(5.0))
    document.apply(DeleteInstances((CAR, OTHER_CAR)))
    report = report_deletion(document, (CAR, OTHER_CAR), 0.0)
    one_by_one, before, count = Document(deepcopy(document.scene)), len(document.history.done), len(document.scene)
    one_by_one.apply(DeleteInstances((CAR, OTHER_CAR)))
    for fill in report.make_fill_edits():
        one_by_one.apply(fill)
    frozen = Document(deepcopy(document.scene))
    frozen.apply(DeleteInstances((CAR, OTHER_CAR)))
    prepared = prepare_fills(frozen, report.make_fill_edits())
    assert prepared.is_prepared_for(document)
    document.apply(prepared.edit)
    assert len(document.history.done) == before + 1
    assert prepared.edit.title == f"Fill 2 holes of {report.fill_area:.1f} m²"
    np.testing.assert_array_equal(document.scene.gaussians.means, one_by_one.scene.gaussians.means)
    np.testing.assert_array_equal(document.state.flags, one_by_one.state.flags)
    document.undo()
    assert len(document.scene) == count
