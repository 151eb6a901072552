"""What stands behind a deleted thing goes on in its own plane."""

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, WALL, parked_street

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.behind.smooth_values import continue_smoothly
from instdrive_core.edits.holes.photo_evidence import gather_photo_evidence
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import color_from_dc


@pytest.fixture(scope="module")
def street():
    return parked_street()


def test_inverse_depth_of_a_plane_is_continued_exactly():
    lines, columns = np.mgrid[:20, :30].astype(np.float64)
    plane = 0.05 + 0.002 * columns + 0.001 * lines
    gap = np.zeros((20, 30), bool)
    gap[5:15, 8:22] = True
    continued = continue_smoothly(np.where(gap, 9.0, plane), ~gap, gap)
    np.testing.assert_allclose(continued, plane, atol=1e-9)


def test_a_gap_that_touches_nothing_known_has_no_depth():
    gap = np.zeros((8, 8), bool)
    gap[2:5, 2:5] = True
    assert not continue_smoothly(np.ones((8, 8)), np.zeros_like(gap), gap)[gap].any()


def test_photos_tell_what_they_reached_past_the_car(street):
    document = Document(deepcopy(street.scene))
    found = gather_photo_evidence(document, [document.find_rows((CAR,))])
    means = document.scene.gaussians.means
    assert np.isin(street.strays, found.lost).all(), "what floats in the car was never seen"
    assert not np.intersect1d(found.seen, found.lost).size
    beside = np.flatnonzero((means[:, 0] < 0.5) & (document.scene.instance_ids == 1))
    assert not np.isin(beside, found.lost).any(), "the photos' side of the car was seen"
    assert 0 < found.gap_share <= 1


def narrow_houses(scene):
    """The scene with its wall cut into fronts of 6 m."""
    wall = scene.instance_ids == WALL
    scene.instance_ids[wall] = 20 + ((scene.gaussians.means[wall, 1] + 12) // 6).astype(np.uint32)
    scene.table = build_instance_table(scene.instance_ids, scene.gaussians.means, scene.codewords, None, {}, {})
    return scene


@pytest.mark.parametrize("houses", [False, True])
def test_the_wall_behind_is_closed_where_it_stands(street, houses):
    scene = narrow_houses(parked_street(wall_top=5.5).scene) if houses else deepcopy(street.scene)
    document = Document(scene)
    document.apply(DeleteInstances((CAR,)))
    report = report_deletion(document, (CAR,), 0.0)
    assert report.holes[0].behind == (CAR,)
    count = len(document.scene)
    document.apply(report.make_fill_edits()[0])
    means = document.scene.gaussians.means[count:]
    high = means[means[:, 2] - 0.02 * means[:, 1] > 0.6]
    assert len(high) > 50
    assert abs(np.median(high[:, 0]) - 6.0) < 0.8, "the wall stands at x = 6, the car's far side at 2.9"
    colors = color_from_dc(document.scene.gaussians.sh_dc[count:])[means[:, 2] - 0.02 * means[:, 1] > 0.6]
    assert np.mean(colors[:, 0] - colors[:, 2] > 0.15) > 0.9, "brick, not paving stones"
    assert document.scene.extra["synthetic"][count:].all()
