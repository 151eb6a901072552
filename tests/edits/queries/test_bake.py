"""What is exported: deleted splats gone, recoloured ones changed, everything else bit-equal."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from random_scene import assert_same_scene, random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.visibility import HideInstances
from instdrive_core.edits.queries.bake import bake_document, freeze_at_time, recount_table
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.maths.spherical_harmonics import evaluate_view_colors

RECOLOR = RecolorInstances((2,), "solid", (1.0, 0.0, 0.0))
MOVE = MoveInstances((3,), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.1))


def test_untouched_documents_bake_to_equal_copies():
    scene = random_scene()
    result = bake_document(Document(scene))
    assert_same_scene(result, scene)
    assert not np.shares_memory(result.gaussians.means, scene.gaussians.means)


def test_deleted_gone_recolored_changed_rest_bit_equal():
    scene = random_scene()
    ids = scene.instance_ids.copy()
    document = Document(scene)
    document.apply(DeleteInstances((1, 8)))
    document.apply(RecolorInstances((2,), "solid", (1.0, 0.25, 0.0)))
    document.apply(RecolorInstances((3,), "tint", (0.0, 0.25, 1.0)))
    document.apply(HideInstances((4,)))
    document.apply(RenameInstance(4, "hidden but kept"))
    result = bake_document(document)
    kept = np.flatnonzero(~np.isin(ids, [1, 8]))
    np.testing.assert_array_equal(result.instance_ids, ids[kept])
    untouched = ~np.isin(result.instance_ids, [2, 3])
    for name, array in scene.gaussians.arrays().items():
        assert getattr(result.gaussians, name)[untouched].tobytes() == array[kept][untouched].tobytes(), name
    for name in ("means", "quats", "log_scales", "opacity_logits", "features"):
        assert getattr(result.gaussians, name).tobytes() == getattr(scene.gaussians, name)[kept].tobytes(), name
    solid = result.instance_ids == 2
    directions = np.random.default_rng(0).normal(size=(solid.sum(), 3)).astype(np.float32)
    shown = evaluate_view_colors(result.gaussians.sh_dc[solid], result.gaussians.sh_rest[solid], directions)
    np.testing.assert_allclose(shown, np.tile([1, 0.25, 0], (len(shown), 1)), atol=1e-6)
    tinted = result.instance_ids == 3
    assert (result.gaussians.sh_dc[tinted] != scene.gaussians.sh_dc[kept][tinted]).any(axis=1).all()
    assert {instance.id for instance in result.table} == {2, 3, 4, 5, 6, 7}
    assert result.table[4].name == "hidden but kept"
    assert sum(instance.count for instance in result.table) == np.count_nonzero(result.instance_ids)


def test_baking_leaves_the_document_alone():
    scene = random_scene()
    document = Document(scene)
    document.apply(RecolorInstances((2,), "solid", (1.0, 0.0, 0.0)))
    before = random_scene()
    bake_document(document, time=0.1).gaussians.means[:] = 0
    assert_same_scene(scene, before)


@pytest.mark.parametrize("edits", [(), (RECOLOR,), (MOVE,), (MOVE, RECOLOR), (DeleteInstances((1,)), MOVE)])
def test_what_is_only_read_is_the_same_and_leaves_the_document_alone(edits):
    document, before = Document(random_scene()), random_scene()
    for edit in edits:
        document.apply(copy(edit))
    result = bake_document(document, 0.1, to_read=True)
    assert_same_scene(result, bake_document(document, 0.1))
    assert_same_scene(document.scene, replace(before, table=document.scene.table))


def test_what_is_only_read_is_not_copied_where_nothing_has_changed_it():
    scene = random_scene()
    document = Document(scene)
    document.apply(copy(RECOLOR))
    result = bake_document(document, to_read=True).gaussians
    shared = {
        name for name, array in result.arrays().items() if np.shares_memory(array, getattr(scene.gaussians, name))
    }
    assert shared >= {"means", "quats", "log_scales"}
    assert not shared & {"sh_dc", "sh_rest", "opacity_logits"}


def test_placed_actors_look_as_they_did_on_their_tracks():
    scene = random_scene(actors=2)
    time = 0.3
    result = freeze_at_time(scene, time)
    assert result.actors == ()
    assert not result.nodes.any()
    poses, present = scene.find_node_poses(time)
    assert present.all()
    rng = np.random.default_rng(0)
    eye = rng.normal(0, 20, 3)
    for row in np.flatnonzero(scene.nodes)[::5]:
        rotation, shift = poses[scene.nodes[row]][:3, :3], poses[scene.nodes[row]][:3, 3]
        world = rotation @ scene.gaussians.means[row] + shift
        np.testing.assert_allclose(result.gaussians.means[row], world, rtol=1e-4, atol=1e-4)
        spread = rotation @ matrix_from_quaternion(scene.gaussians.quats[row].astype(float))
        np.testing.assert_allclose(matrix_from_quaternion(result.gaussians.quats[row].astype(float)), spread, atol=1e-5)
        direction = (world - eye) / np.linalg.norm(world - eye)
        in_frame = (rotation.T @ direction)[None].astype(np.float32)
        one = slice(row, row + 1)
        before = evaluate_view_colors(scene.gaussians.sh_dc[one], scene.gaussians.sh_rest[one], in_frame)
        after = evaluate_view_colors(
            result.gaussians.sh_dc[one], result.gaussians.sh_rest[one], direction[None].astype(np.float32)
        )
        np.testing.assert_allclose(after, before, atol=1e-5)
    still = scene.nodes == 0
    assert result.gaussians.sh_rest[still].tobytes() == scene.gaussians.sh_rest[still].tobytes()


@pytest.mark.parametrize(("time", "present"), [(0.0, {7}), (0.3, {7, 8}), (0.6, {8}), (9.0, set())])
def test_actors_are_left_out_when_they_are_not_there(time, present):
    scene = random_scene(actors=2)
    result = freeze_at_time(scene, time)
    assert {instance.id for instance in result.table} - set(range(7)) == present
    assert len(result) == np.isin(scene.nodes, [0, *(instance - 6 for instance in present)]).sum()
    assert len(result.extra["confidence"]) == len(result)


def test_static_scenes_are_placed_already():
    scene = random_scene(actors=0)
    assert freeze_at_time(scene, 3.0) is scene


def test_recounting_drops_empty_instances_and_keeps_names():
    scene = random_scene()
    scene.instance_ids[scene.instance_ids == 2] = 1
    table = recount_table(scene).table
    assert 2 not in table
    assert (table[1].name, table[1].class_name) == ("parked – “taxi”", "Car")
    assert table[1].count == (scene.instance_ids == 1).sum()
