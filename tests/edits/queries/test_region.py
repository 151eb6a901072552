"""Instances and splats in a region of the picture, against the rasterizer's own ID image."""

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, ROAD, procedural_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.visibility import HideInstances
from instdrive_core.edits.queries.region import find_instances_in_region, find_rows_in_region
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.rasterize.preview import render_preview
from instdrive_core.scene.scene import place_in_world
from instdrive_core.scene.screen_region import rasterize_polygon


@pytest.fixture(scope="module")
def scene():
    return procedural_street()


@pytest.fixture
def document(scene):
    return Document(scene)


@pytest.fixture(scope="module")
def camera(scene):
    return scene.views[0].camera


@pytest.fixture(scope="module")
def winners(scene, camera):
    """Row + 1 per pixel."""
    poses, _ = scene.find_node_poses(0.0)
    gaussians = scene.gaussians
    means, quats = place_in_world(gaussians.means, gaussians.quats, scene.nodes, poses)
    colors = color_from_dc(gaussians.sh_dc)
    return (render_preview(means, quats, gaussians.log_scales, gaussians.opacities, colors, camera).winner + 1).astype(
        np.uint32
    )


def shown_ids(scene, winners):
    return np.append(np.uint32(0), scene.instance_ids)[winners]


def box_around(mask, margin=1):
    rows, columns = np.nonzero(mask)
    left, right = columns.min() - margin, columns.max() + 1 + margin
    top, bottom = rows.min() - margin, rows.max() + 1 + margin
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float)
    return rasterize_polygon(corners, mask.shape[1], mask.shape[0])


@pytest.mark.parametrize("car", [FIRST_CAR, FIRST_CAR + 1, DRIVING_CAR])
def test_a_rectangle_around_a_car_takes_the_car_and_not_the_road(scene, document, camera, winners, car):
    region = box_around(shown_ids(scene, winners) == car)
    found = find_instances_in_region(document, camera, 0.0, region, winners)
    assert car in found
    assert ROAD not in found


def test_the_share_of_visible_pixels_decides(scene, document, camera, winners):
    mask = shown_ids(scene, winners) == FIRST_CAR
    pixels = np.argwhere(mask)
    for share in (0.3, 0.49, 0.51, 0.8):
        region = np.zeros_like(mask)
        region[tuple(pixels[: int(share * len(pixels))].T)] = True
        found = find_instances_in_region(document, camera, 0.0, region, winners)
        assert found == ((FIRST_CAR,) if share > 0.5 else ())
        assert (FIRST_CAR in find_instances_in_region(document, camera, 0.0, region, winners, 0.75)) == (share > 0.75)


def test_without_winners_what_is_hidden_counts_too(scene, document, camera, winners):
    everywhere = np.ones(winners.shape, bool)
    seen = set(find_instances_in_region(document, camera, 0.0, everywhere, winners))
    assert seen == set(np.unique(shown_ids(scene, winners)).tolist()) - {0}
    means, _ = compute_shown_means(document, 0.0)
    pixels, depth = camera.project(means)
    inside = (depth >= 0.1) & (pixels >= 0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
    ids = scene.instance_ids
    expected = {i.id for i in scene.table if inside[ids == i.id].mean() > 0.5}
    assert set(find_instances_in_region(document, camera, 0.0, everywhere)) == expected


def test_splats_are_taken_by_their_centres_and_only_visible_ones_where_asked(scene, document, camera, winners):
    region = box_around(shown_ids(scene, winners) == FIRST_CAR)
    rows = find_rows_in_region(document, camera, 0.0, region)
    means, _ = compute_shown_means(document, 0.0)
    pixels, depth = camera.project(means)
    columns, lines = np.floor(pixels).astype(int).T
    inside = (depth >= 0.1) & (columns >= 0) & (columns < camera.width) & (lines >= 0) & (lines < camera.height)
    inside[inside] = region[lines[inside], columns[inside]]
    np.testing.assert_array_equal(rows, np.flatnonzero(inside))
    visible = find_rows_in_region(document, camera, 0.0, region, winners)
    np.testing.assert_array_equal(visible, np.intersect1d(rows, np.unique(winners) - 1))
    assert 0 < len(visible) < len(rows)


def test_hidden_deleted_and_absent_splats_are_in_no_region(scene, document, camera):
    document.apply(HideInstances((FIRST_CAR,)))
    document.apply(DeleteInstances((FIRST_CAR + 1,)))
    everywhere = np.ones((camera.height, camera.width), bool)
    gone = {FIRST_CAR, FIRST_CAR + 1}
    assert not gone & set(find_instances_in_region(document, camera, 0.0, everywhere))
    assert not gone & set(scene.instance_ids[find_rows_in_region(document, camera, 0.0, everywhere)].tolist())
    assert DRIVING_CAR in find_instances_in_region(document, camera, 0.0, everywhere)
    assert DRIVING_CAR not in find_instances_in_region(document, camera, 99.0, everywhere)


def test_an_empty_region_holds_nothing(document, camera, winners):
    nowhere = np.zeros(winners.shape, bool)
    assert find_instances_in_region(document, camera, 0.0, nowhere, winners) == ()
    assert find_instances_in_region(document, camera, 0.0, nowhere) == ()
    assert len(find_rows_in_region(document, camera, 0.0, nowhere)) == 0
