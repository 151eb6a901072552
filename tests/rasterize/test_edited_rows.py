"""Rows kept up to date one range at a time, against baking the whole document."""

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.relative_adjustment import AdjustInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.rasterize import edited_rows
from instdrive_core.rasterize.edited_rows import (
    RowFrames,
    compute_world_shapes,
    write_largest_log_scales,
    write_shown_opacities,
    write_world_means,
)
from instdrive_core.rasterize.pixel_contributors import find_rows_near_pixel
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.selection import Flag

TIME = 0.15


@pytest.fixture
def document():
    document = Document(random_scene(count=400))
    document.apply(MoveInstances((2, 3), (1.0, -2.0, 0.5), rotation=(0.8, 0.1, -0.3, 0.5), scale=1.7))
    document.apply(MoveInstances((7,), (0.3, 0.2, 0.1), rotation=(0.9, 0.0, 0.0, 0.2), scale=0.6, time=TIME))
    document.apply(MoveInstances((3,), (0.0, 1.0, 0.0)))
    document.apply(AdjustInstances((4,), "opacity", 0.4))
    document.apply(DuplicateInstances((2, 7), (0.0, 3.0, 0.0)))
    return document


def arrays_of(document, ranges):
    scene, count = document.scene, len(document.scene)
    poses, present = scene.find_node_poses(TIME)
    frames, entries = RowFrames.copy_from(document.transforms, poses), document.transforms.indices
    means, sizes = np.full((count, 3), np.nan, np.float32), np.full((count, 1), np.nan, np.float32)
    opacities = np.full(count, np.nan, np.float32)
    hidden, flags = int(Flag.DELETED | Flag.HIDDEN), document.state.flags
    for rows in ranges:
        write_world_means(scene.gaussians.means, entries, scene.nodes, frames, rows, means)
        write_largest_log_scales(scene.gaussians.log_scales, entries, frames, rows, sizes)
        logits = scene.gaussians.opacity_logits
        write_shown_opacities(logits, document.colors, flags, hidden, scene.nodes, present, rows, opacities)
    return frames, means, sizes, opacities


def test_ranges_together_are_what_baking_gives(document):
    scene, count = document.scene, len(document.scene)
    assert scene.find_node_poses(TIME)[1].all(), "no row is left out of the baked scene"
    expected = bake_document(document, TIME).gaussians
    frames, means, sizes, opacities = arrays_of(document, [(0, 150), (150, count)])
    np.testing.assert_allclose(means, expected.means, atol=1e-5)
    np.testing.assert_allclose(sizes[:, 0], expected.log_scales.max(axis=1), atol=1e-5)
    np.testing.assert_allclose(opacities, expected.opacities, rtol=2e-5)
    rows = np.arange(count)[::-3]
    quats, log_scales = compute_world_shapes(scene.gaussians, document.transforms.indices, scene.nodes, frames, rows)
    np.testing.assert_allclose(log_scales, expected.log_scales[rows], atol=1e-5)
    turns = np.abs((quats * expected.quats[rows]).sum(axis=1))
    lengths = np.linalg.norm(quats, axis=1) * np.linalg.norm(expected.quats[rows], axis=1)
    np.testing.assert_allclose(turns / lengths, 1, atol=1e-5)


def test_rows_outside_the_range_are_left_alone(document):
    _, means, sizes, opacities = arrays_of(document, [(20, 30)])
    for array in (means, sizes, opacities):
        written = np.isfinite(array.reshape(len(array), -1)).all(axis=1)
        assert np.flatnonzero(written).tolist() == list(range(20, 30))


def test_arrays_that_cannot_be_written_need_no_other_kernels(document):
    arrays_of(document, [(0, 10)])
    kernels = (edited_rows._place_means, edited_rows._largest_log_scales, edited_rows._shown_opacities)
    before = [len(kernel.signatures) for kernel in kernels]
    gaussians = document.scene.gaussians
    for array in (gaussians.means, gaussians.log_scales, gaussians.opacity_logits, document.scene.nodes):
        array.flags.writeable = False
    arrays_of(document, [(0, 10)])
    assert [len(kernel.signatures) for kernel in kernels] == before


def test_deleted_rows_and_absent_actors_have_no_opacity(document):
    document.apply(DeleteInstances((4,)))
    scene = document.scene
    present = np.array([1, 0, *[1] * (len(scene.actors) - 1)], np.uint8)
    opacities = np.full(len(scene), np.nan, np.float32)
    logits, flags = scene.gaussians.opacity_logits, document.state.flags
    write_shown_opacities(logits, document.colors, flags, 10, scene.nodes, present, (0, len(scene)), opacities)
    np.testing.assert_array_equal(opacities == 0, (scene.instance_ids == 4) | (scene.nodes == 1))


def test_the_largest_axis_finds_the_same_rows_as_all_three(document):
    _, means, sizes, opacities = arrays_of(document, [(0, len(document.scene))])
    camera = Camera(60.0, 61.0, 32.0, 24.0, 64, 48, look_at(np.array([9.0, -8, 3]), np.zeros(3)))
    log_scales = np.repeat(sizes, 3, axis=1) - np.array([0, 1, 2], np.float32)
    near = find_rows_near_pixel(means, sizes, opacities, camera, 30, 20)
    assert 0 < len(near) < len(means)
    np.testing.assert_array_equal(near, find_rows_near_pixel(means, log_scales, opacities, camera, 30, 20))
    with pytest.raises(ValueError, match="outside"):
        find_rows_near_pixel(means, sizes, opacities, camera, 64, 20)
