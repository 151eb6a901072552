"""Behind a hedge that is wider than any single object, what shows above it goes on down to the ground."""

import numpy as np
import pytest
from parked_street import KERB, PAVEMENT, ROAD, WALL, parked_street, scene_of

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.deletions.prepared_fill import prepare_fills
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.deleted_neighbors import group_neighbors
from instdrive_core.edits.holes.standing_height import hides_too_much, measure_height
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.errors import EditError
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.camera import Camera, CameraView, look_at

HEDGE = 9
TOP = 1.3
BRICK, GREEN = (0.6, 0.4, 0.3), (0.1, 0.4, 0.1)


def level_views():
    """A car drives by in the left lane and looks to the right, over the hedge."""
    eyes = [np.array([-2.0, y, 1.8 + 0.02 * y]) for y in np.arange(-8, 8, 2.0)]
    poses = [look_at(eye, eye + np.array([5.0, 1.0, 0.0])) for eye in eyes]
    cameras = [Camera(200.0, 200.0, 200.0, 120.0, 400, 240, pose) for pose in poses]
    return tuple(CameraView(camera, "right_camera", index, 0.2 * index) for index, camera in enumerate(cameras))


def hedged_street(wall_top=6.0, top=TOP, half=12.0):
    """The street without cars, with a hedge along the pavement; what the hedge hides of it and of a wall is missing.

    The hedge goes `half` metres to both sides.
    """
    rng = np.random.default_rng(2)
    empty = parked_street().empty
    kept = np.isin(empty.instance_ids, (ROAD, PAVEMENT)) & (empty.gaussians.means[:, 0] < 4.6)
    ground, ground_ids = empty.gaussians.means[kept].astype(np.float64), empty.instance_ids[kept]
    wall = np.stack(np.meshgrid([6.0], np.arange(-12, 12, 0.12), np.arange(1.0, wall_top, 0.12)), -1).reshape(-1, 3)
    hedge = rng.uniform([4.2, -half, KERB], [4.6, half, KERB + top], (round(4000 * top), 3))
    hedge[:, 2] += 0.02 * hedge[:, 1]
    colors = [
        color_from_dc(empty.gaussians.sh_dc[kept]),
        np.tile(BRICK, (len(wall), 1)),
        np.tile(GREEN, (len(hedge), 1)),
    ]
    ids = np.repeat([WALL, HEDGE], [len(wall), len(hedge)])
    means = np.concatenate([ground, wall, hedge])
    scene = scene_of(rng, means, np.concatenate([ground_ids, ids]), np.concatenate(colors), level_views())
    return Document(scene)


def members(document, *numbers):
    return [(number, document.find_rows((number,))) for number in numbers]


def test_the_wall_above_a_hedge_goes_on_behind_it():
    document = hedged_street()
    document.apply(DeleteInstances((HEDGE,)))
    report = report_deletion(document, (HEDGE,), 0.0)
    assert (report.holes, report.hole_text) == ((), "a gap behind it")
    count = len(document.scene)
    (fill,) = report.make_fill_edits()
    assert fill.title == "Fill gap"
    document.apply(fill)
    means = document.scene.gaussians.means[count:]
    level = means[:, 2] - 0.02 * means[:, 1]
    wall = (level > 0.5) & (level < 1.0)
    assert wall.sum() > 100
    assert abs(np.median(means[wall, 0]) - 6.0) < 0.5, "the wall stands at x = 6"
    colors = color_from_dc(document.scene.gaussians.sh_dc[count:])[wall]
    assert np.mean(colors[:, 0] - colors[:, 1] > 0.1) > 0.9, "brick, not hedge"


def test_a_hedge_before_the_open_sky_hid_nothing():
    document = hedged_street(wall_top=1.2)
    document.apply(DeleteInstances((HEDGE,)))
    report = report_deletion(document, (HEDGE,), 0.0)
    assert report.clearings == ()


def test_where_nothing_goes_on_a_fill_is_refused():
    document = hedged_street()
    document.apply(DeleteInstances((HEDGE,)))
    fills = report_deletion(document, (HEDGE,), 0.0).make_fill_edits()
    document.apply(DeleteInstances((WALL, ROAD, PAVEMENT)))
    with pytest.raises(EditError, match="nothing stands around it that would go on there"):
        prepare_fills(document, fills)


def test_what_is_higher_than_can_be_continued_stays_open():
    document = hedged_street(wall_top=16.0, top=8.0)
    document.apply(DeleteInstances((HEDGE,)))
    assert report_deletion(document, (HEDGE,), 0.0).hole_text.endswith("nothing higher than 6 m is filled behind")


def test_a_single_thing_as_large_as_a_house_is_not_filled_behind():
    document = hedged_street(wall_top=16.0, top=8.0, half=4.5)
    document.apply(DeleteInstances((HEDGE,)))
    report = report_deletion(document, (HEDGE,), 0.0)
    assert report.hole_text.endswith("nothing higher than 6 m is filled behind")
    assert not any(hole.behind for hole in report.holes)
    assert len(report.residue) > 500, "what the photos never showed is no wall"


@pytest.mark.parametrize(("foot", "is_house"), [(8.0, True), (0.4, False)])
def test_a_crown_on_a_trunk_is_no_house(foot, is_house):
    rng = np.random.default_rng(0)
    low = rng.uniform([-foot / 2, 0, 0], [foot / 2, 0.4, 3], (800, 3))
    means = np.concatenate([low, rng.uniform([-4, -1, 3], [4, 1, 8], (2000, 3))])
    ids = np.full(len(means), HEDGE)
    document = Document(scene_of(rng, means, ids, np.tile(GREEN, (len(means), 1)), level_views()))
    assert hides_too_much(document, document.find_rows((HEDGE,))) == is_house


def test_what_no_photo_reached_is_residue_where_nothing_fills():
    document = hedged_street(wall_top=16.0, top=8.0)
    document.apply(DeleteInstances((HEDGE,)))
    residue = report_deletion(document, (HEDGE,), 0.0).residue
    assert len(residue) > 1000
    places = document.scene.gaussians.means[residue]
    assert np.mean(places[:, 0] > 4.0) > 0.98, "photos show what is before the hedge"
    assert places[:, 2].max() < 10, "photos show the wall from 9.7 m on"


def test_wide_things_are_reviewed_alone():
    document = hedged_street()
    assert group_neighbors(document, members(document, HEDGE, ROAD, WALL), 0.0) == [[0], [1], [2]]


def test_height_is_that_of_what_stands_on_a_slope():
    rng = np.random.default_rng(0)
    points = rng.uniform([0, 0, 0], [30, 0.5, 2], (3000, 3))
    points[:, 2] += 0.1 * points[:, 0]
    assert measure_height(points) == pytest.approx(2.0, abs=0.15)


def test_ground_has_no_height_whatever_trained_below_it():
    rng = np.random.default_rng(0)
    points = rng.uniform([0, 0, -0.02], [20, 6, 0.02], (4000, 3))
    points[:1500, 2] -= rng.uniform(0, 3, 1500)
    assert measure_height(points) == 0
