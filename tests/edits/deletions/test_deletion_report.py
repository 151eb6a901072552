"""What a deletion leaves: strays under other labels, and ground that only the deleted car ever covered."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, CAR_SIZE, OTHER_CAR, PAVEMENT, ROAD, WALL, parked_street
from random_scene import random_scene

from instdrive_core.edits.deletions.deletion_report import report_deletion, report_row_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.surroundings import find_surroundings
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteSelected
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.kinds.visibility import LockInstances
from instdrive_core.errors import EditError
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.track import Track


def under_car(hole):
    """How many of a hole's cells lie in the footprint of the car, and how many do not."""
    inside = (np.abs(hole.grid.compute_centers(hole.cells) - CAR_CENTER[:2]) <= CAR_SIZE[:2] / 2).all(axis=1)
    return np.count_nonzero(inside), np.count_nonzero(~inside)


@pytest.fixture(scope="module")
def street():
    return parked_street()


def test_strays_and_the_ground_never_seen_are_reported(street):
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((CAR,)))
    report = report_deletion(document, (CAR,), 0.0)
    assert np.isin(street.strays, report.residue).all()
    count = len(report.residue)
    assert count < 1.25 * len(street.strays)
    assert report.carriers == {PAVEMENT: count}
    inside, _ = under_car(report.holes[0])
    assert inside * report.holes[0].grid.size ** 2 == pytest.approx(CAR_SIZE[0] * CAR_SIZE[1], rel=0.1)
    across = report.holes[0].grid.compute_centers(report.holes[0].cells)[:, 0]
    assert (across > CAR_CENTER[0] - CAR_SIZE[0] / 2 - 0.5).all(), "the photos' side was seen"
    assert (across < 6.2).all(), "nothing behind the wall is a hole"
    assert report.summary == f"{count} splats of residue, hole of {report.hole_area:.1f} m²"
    assert report.name == "Car 7"
    corners = report.holes[0].outlines
    np.testing.assert_allclose(corners[..., 2], 0.02 * corners[..., 1], atol=0.02)


def test_a_report_before_the_deletion_is_that_of_after(street):
    document = Document(deepcopy(street.scene))
    before = report_deletion(document, (CAR,), 0.0)
    document.apply(DeleteInstances((CAR,)))
    after = report_deletion(document, (CAR,), 0.0)
    np.testing.assert_array_equal(before.residue, after.residue)
    np.testing.assert_array_equal(before.holes[0].cells, after.holes[0].cells)


def test_ground_that_photos_reached_is_no_hole(street):
    """The side of the other car that faces the photos is whole."""
    document = Document(deepcopy(street.empty))
    document.apply(DeleteInstances((OTHER_CAR,)))
    report = report_deletion(document, (OTHER_CAR,), 0.0)
    across = report.holes[0].grid.compute_centers(report.holes[0].cells)[:, 0]
    assert (across > CAR_CENTER[0] - CAR_SIZE[0] / 2 - 0.5).all()
    assert report.make_absorb_edit() is None or len(report.residue) < 10


def test_without_photos_the_footprint_is_what_may_be_missing():
    street = parked_street(views=False)
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((CAR,)))
    inside, outside = under_car(report_deletion(document, (CAR,), 0.0).holes[0])
    assert inside > 150
    assert outside < 0.3 * inside


def test_absorbing_empties_the_residue(street):
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((CAR,)))
    report = report_deletion(document, (CAR,), 0.0)
    flags = document.state.flags.copy()
    document.apply(report.make_absorb_edit())
    again = report_deletion(document, (CAR,), 0.0).residue
    assert len(again) < 0.1 * len(report.residue)
    assert not np.isin(again, report.residue).any()
    assert document.state.find_mask(Flag.DELETED)[street.strays].all()
    document.undo()
    np.testing.assert_array_equal(document.state.flags, flags)
    np.testing.assert_array_equal(report_deletion(document, (CAR,), 0.0).residue, report.residue)


def test_a_lassoed_car_leaves_what_the_lasso_missed(street):
    document = Document(deepcopy(street.scene))
    members = document.find_rows((CAR,))
    missed = members[::20]
    rows = np.setdiff1d(members, missed)
    document.apply(SelectRows(rows))
    document.apply(DeleteSelected())
    report = report_row_deletion(document, rows, 0.0)
    assert np.isin(street.strays, report.residue).all()
    assert np.isin(missed, report.residue).mean() > 0.5
    assert set(report.carriers) == {CAR, PAVEMENT}
    whole = report_deletion(Document(deepcopy(street.scene)), (CAR,), 0.0)
    assert report.hole_area == pytest.approx(whole.hole_area, rel=0.3)
    document.apply(report.make_absorb_edit())
    assert not np.isin(report.residue, report_row_deletion(document, rows, 0.0).residue).any()
    assert document.state.find_mask(Flag.DELETED)[report.residue].all()


def test_a_car_that_was_moved_there_stays_whole_and_so_does_what_stands_behind_it(street):
    lost = []
    for move in ((0.0, 0.0, 0.0), (0.0, -3.5, -0.07)):
        document = Document(deepcopy(street.scene))
        document.apply(MoveInstances((OTHER_CAR,), move))
        document.apply(DeleteInstances((CAR,)))
        report = report_deletion(document, (CAR,), 0.0)
        for edit in (report.make_absorb_edit(), *report.make_fill_edits()):
            document.apply(edit)
        lost.append(document.state.find_mask(Flag.DELETED)[: len(street.scene)])
    assert not lost[1][document.find_rows((OTHER_CAR,))].any(), "photos saw it elsewhere, and say nothing about it"
    wall = street.scene.instance_ids == WALL
    assert np.count_nonzero(lost[1] & wall) <= np.count_nonzero(lost[0] & wall), "photos saw it without the car"


def test_a_car_stays_whole_where_the_hole_it_left_is_filled(street):
    document = Document(deepcopy(street.scene))
    report = report_deletion(document, (CAR,), 0.0)
    document.apply(MoveInstances((CAR,), (-2.5, -2.0, -0.04)))
    document.apply(report.make_fill_edits()[0])
    assert not document.state.find_mask(Flag.DELETED)[document.find_rows((CAR,))].any()
    count = len(street.scene)
    added = document.scene.gaussians.means[count:]
    high = added[added[:, 2] - 0.02 * added[:, 1] > 0.6]
    assert len(high) > 50, "the wall behind is closed, too"
    assert abs(np.median(high[:, 0]) - 6.0) < 0.8


def test_what_was_put_elsewhere_leaves_nothing_where_it_stands(street):
    document = Document(deepcopy(street.scene))
    document.apply(MoveInstances((CAR,), (-3.0, -6.0, -0.12)))
    report = report_deletion(document, (CAR,), 0.0)
    assert not report.holes
    assert not len(report.residue)


def test_locked_strays_are_spared(street):
    document = Document(deepcopy(street.scene))
    document.apply(LockInstances((PAVEMENT,)))
    document.apply(DeleteInstances((CAR,)))
    assert not len(report_deletion(document, (CAR,), 0.0).residue)


def test_surfaces_and_moving_objects_leave_no_hole(street):
    document = Document(deepcopy(street.scene))
    report = report_deletion(document, (ROAD,), 0.0)
    assert (len(report.residue), report.holes) == (0, ())
    driving = Document(random_scene())
    report = report_deletion(driving, (7, 8), 0.2)
    assert report.name == "2 instances"
    assert report.hole_area == 0
    with pytest.raises(EditError, match="no instance 99"):
        report_deletion(document, (99,), 0.0)


def test_a_piece_with_a_label_of_its_own_is_residue(street):
    """A few splats of the class that hang on the car's side; another car stays what it is."""
    scene = deepcopy(street.scene)
    beside = np.flatnonzero(scene.instance_ids == CAR)[:40]
    scene.gaussians.means[beside] = (CAR_CENTER + np.array([-1.2, 0.5, 0.1])).astype(np.float32)
    scene.gaussians.means[beside] += np.random.default_rng(0).uniform(-0.25, 0.25, (40, 3)).astype(np.float32)
    scene.instance_ids[beside] = 9
    classes = {CAR: "Car", OTHER_CAR: "Car", 9: "Car"}
    scene.table = build_instance_table(scene.instance_ids, scene.gaussians.means, None, None, {}, classes)
    document = Document(scene)
    document.apply(DeleteInstances((CAR,)))
    carriers = report_deletion(document, (CAR,), 0.0).carriers
    assert carriers[9] == 40
    assert carriers[PAVEMENT] == pytest.approx(len(street.strays), rel=0.25)
    stranger = deepcopy(scene)
    stranger.table.set(replace(stranger.table[9], class_name="Pedestrian"))
    assert report_deletion(Document(stranger), (CAR,), 0.0).carriers.get(9, 0) < 20


def test_the_shadow_of_what_is_deleted_goes_with_it_and_that_of_a_house_stays(street):
    scene, ground = deepcopy(street.scene), np.isin(street.scene.instance_ids, (ROAD,))
    x, y = scene.gaussians.means[:, 0], scene.gaussians.means[:, 1]
    shaded = np.flatnonzero(ground & (x > 0.2) & (x < 1.2) & (np.abs(y) < 2.2))
    scene.gaussians.sh_dc[shaded] = dc_from_color(0.4 * color_from_dc(scene.gaussians.sh_dc[shaded]))
    report = report_deletion(Document(scene), (CAR,), 0.0)
    lit = report.holes[0].grid.compute_centers(report.holes[0].shadow)
    assert report.holes[0].shadow_area > 2
    assert (np.abs(lit - [0.7, 0.0]) < [0.9, 2.7]).all()
    assert f"{report.holes[0].shadow_area:.1f} m² of it in the shadow" in report.summary
    house = np.flatnonzero(ground & (x > 0.2) & (np.abs(y) < 9))
    scene.gaussians.sh_dc[house] = dc_from_color(np.full((len(house), 3), 0.13))
    assert report_deletion(Document(scene), (CAR,), 0.0).holes[0].shadow_area == 0


@pytest.mark.parametrize(("edge", "taken"), [(0.75, True), (1.0, False)])
def test_the_soft_edge_of_a_shadow_in_the_sun_belongs_to_the_hole(street, edge, taken):
    scene, ground = deepcopy(street.scene), np.isin(street.scene.instance_ids, (ROAD,))
    x, y = scene.gaussians.means[:, 0], scene.gaussians.means[:, 1]
    for left, right, share in ((0.3, 0.7, edge), (0.7, 1.2, 0.45)):
        rows = np.flatnonzero(ground & (x > left) & (x < right) & (np.abs(y) < 2.2))
        scene.gaussians.sh_dc[rows] = dc_from_color(share * color_from_dc(scene.gaussians.sh_dc[rows]))
    hole = report_deletion(Document(scene), (CAR,), 0.0).holes[0]
    places = hole.grid.compute_centers(np.concatenate([hole.cells, hole.shadow]))
    inside = np.count_nonzero((np.abs(places - [0.5, 0.0]) < [0.1, 1.6]).all(axis=1))
    assert (inside * hole.grid.size > 0.8 * 3.2) == taken


def test_an_actor_with_strays_in_the_background_is_an_actor():
    """Its body is made of its own node's splats, and where it drove was seen before and after."""
    scene = deepcopy(parked_street().empty)
    rows = np.flatnonzero(scene.instance_ids == OTHER_CAR)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = CAR_CENTER + np.array([[0.0, -20, 0], [0.0, 0, 0], [0.0, 20, 0]])
    scene.actors = (Track("driver", "Car", CAR_SIZE, np.array([0.0, 0.6, 1.2]), poses, moving=True),)
    scene.gaussians.means[rows] -= (CAR_CENTER + np.array([0.0, 6.5, 0.13])).astype(np.float32)
    scene.nodes[rows[100:]] = 1
    document = Document(scene)
    document.apply(DeleteInstances((OTHER_CAR,)))
    report = report_deletion(document, (OTHER_CAR,), 0.6)
    assert report.hole_area == 0
    around = find_surroundings(document, [(OTHER_CAR, document.find_rows((OTHER_CAR,)))], 0.6)
    assert len(around.deleted[0].points) == len(rows) - 100


def test_a_gap_without_ground_around_is_told(street):
    document = Document(deepcopy(street.scene))
    document.apply(DeleteInstances((ROAD, PAVEMENT)))
    document.apply(DeleteInstances((CAR,)))
    report = report_deletion(document, (CAR,), 0.0)
    assert report.holes == ()
    assert report.hole_text == "no ground found around it to fill from"
