"""Turning the whole scene: everything goes along, looks as it did, and comes back to the bit."""

from dataclasses import replace

import numpy as np
import pytest
from random_scene import assert_same_scene, random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import fingerprint
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.document.invariants import find_broken_invariants
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.kinds.visibility import LockInstances
from instdrive_core.edits.queries.bake import bake_document, freeze_at_time
from instdrive_core.edits.serialize import edit_from_json, edits_from_lines, edits_to_lines
from instdrive_core.errors import EditError
from instdrive_core.instances.table import compute_middle_bounds
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.pose_transforms import rotate_sky
from instdrive_core.scene.scene import place_in_world
from instdrive_core.scene.sky import Sky, compute_texel_directions
from instdrive_core.scene.upright import AXES, compute_axis_direction, compute_upright_rotation

ANY_TURN = (0.8, 0.1, -0.3, 0.5)
NEARLY_DOWN = [np.array([x, 0.3 * x, -1.0]) for x in (1e-2, 1e-4, 1e-6, 1e-9, 1e-13)]
AXIS_TURNS = [TurnScene.make_upright(tuple(compute_axis_direction(axis))) for axis in AXES if axis != "+z"]


def world_means(document, time):
    scene = document.scene
    poses, _ = scene.find_node_poses(time)
    means = document.compute_means(np.arange(len(scene)))
    return place_in_world(means, scene.gaussians.quats, scene.nodes, poses)[0]


@pytest.mark.parametrize("edit", [*AXIS_TURNS, TurnScene(ANY_TURN, 0.4)], ids=lambda edit: edit.title)
def test_every_dataset_camera_sees_the_same_picture(edit):
    """Splats, SH, drives, cameras and sky have all been turned and scaled if, and only if, pictures stay."""
    directions = compute_texel_directions(32)
    sky = Sky((0.5 + 0.5 * directions / np.linalg.norm(directions, axis=-1, keepdims=True)).astype(np.float32))
    document = Document(replace(random_scene(), sky=sky))
    before = [view_scene(document.scene, view.camera, view.time) for view in document.scene.views[1::3]]
    document.apply(edit)
    turned = bake_document(document)
    for frame, view in zip(before, turned.views[1::3], strict=True):
        after = view_scene(turned, view.camera, view.time)
        np.testing.assert_allclose(after.alpha, frame.alpha, atol=2e-3)
        np.testing.assert_allclose(after.color, frame.color, atol=2e-2)  # at the sky's edges
        assert frame.color.std() > 0.05


def test_a_sky_turned_by_quarters_keeps_its_texels():
    sky = random_scene().sky
    for edit in AXIS_TURNS:
        found = np.sort(rotate_sky(sky, edit.linear).faces.reshape(-1))
        np.testing.assert_allclose(found, np.sort(sky.faces.reshape(-1)), atol=1e-6)


@pytest.mark.parametrize("axis", AXES)
def test_what_pointed_there_points_up_and_coordinates_are_kept(axis):
    document = Document(random_scene())
    means = document.scene.gaussians.means
    document.apply(TurnScene.make_upright(tuple(compute_axis_direction(axis))))
    still = document.scene.nodes == 0
    found = document.compute_means(np.flatnonzero(still))
    np.testing.assert_array_equal(found[:, 2], means[still] @ compute_axis_direction(axis).astype(np.float32))
    np.testing.assert_array_equal(np.sort(np.abs(found), axis=1), np.sort(np.abs(means[still]), axis=1))


def test_it_is_one_step_and_undo_restores_every_bit():
    document = Document(random_scene())
    document.apply(MoveInstances((2,), (1.0, 0.5, 0.0), ANY_TURN, 1.2))
    document.apply(MoveInstances((7,), (0.0, 2.0, 0.0), scale=0.7))
    document.apply(LockInstances((3,)))
    digest, scene = fingerprint(document), bake_document(document)
    views, sky, orientation = document.scene.views, document.scene.sky, document.orientation
    document.apply(TurnScene(ANY_TURN, 0.01))
    after = fingerprint(document), bake_document(document)
    assert document.history.cursor == 4
    assert not find_broken_invariants(document)
    document.undo()
    assert fingerprint(document) == digest
    assert_same_scene(bake_document(document), scene)
    assert document.scene.views is views
    assert document.scene.sky is sky
    assert document.orientation is orientation
    document.redo()
    assert fingerprint(document) == after[0]
    assert_same_scene(bake_document(document), after[1])


def test_it_is_replayed_from_its_lines():
    edit = TurnScene.make_upright((0.0, -1.0, 0.2), 0.5)
    first, second = Document(random_scene()), Document(random_scene())
    first.apply(edit)
    (again,) = edits_from_lines(edits_to_lines([edit]))
    second.apply(again)
    assert again == edit
    assert fingerprint(first) == fingerprint(second)


def test_moved_things_are_reset_to_where_the_turn_has_put_them():
    """Not back to where they lie on their side; nor do copies, drives and what was moved before the turn."""
    turned, moved = Document(random_scene()), Document(random_scene())
    turn = TurnScene.make_upright((0.0, -1.0, 0.0), 2.0)
    turned.apply(turn)
    moved.apply(MoveInstances((2, 7), (1.0, 2.0, 0.0), ANY_TURN, 1.5))
    moved.apply(turn)
    moved.apply(MoveInstances((3, 8), (0.0, 1.0, 0.0), ANY_TURN, 0.9))
    moved.apply(ResetMoves((2, 3, 7, 8)))
    assert_same_scene(bake_document(moved), bake_document(turned))
    rows = turned.find_rows((4,))
    turned.apply(DuplicateInstances((4,), (0.0, 0.0, 9.0)))
    copy = max(entry.id for entry in turned.scene.table)
    turned.apply(ResetMoves((copy,)))
    np.testing.assert_array_equal(turned.compute_means(turned.find_rows((copy,))), turned.compute_means(rows))


def test_bounds_are_those_of_the_splats():
    for edit in (*AXIS_TURNS, TurnScene(ANY_TURN, 3.0)):
        document = Document(random_scene())
        document.apply(edit)
        for entry in document.scene.table:
            rows = document.find_rows((entry.id,))
            rows = rows[document.scene.nodes[rows] == entry.node]
            np.testing.assert_allclose(entry.bounds, compute_middle_bounds(document.compute_means(rows)), atol=1e-5)


def test_prepared_aside_it_gives_the_same_and_only_for_what_it_was_prepared_for():
    edit, prepared, plain = TurnScene(ANY_TURN, 3.0), Document(random_scene()), Document(random_scene())
    edit.prepare(freeze_document(prepared))
    for document, turn in ((prepared, edit), (plain, TurnScene(ANY_TURN, 3.0))):
        document.apply(turn)
    assert fingerprint(prepared) == fingerprint(plain)
    late, early = TurnScene(ANY_TURN, 3.0), Document(random_scene())
    late.prepare(freeze_document(early))
    for turn in (late, TurnScene(ANY_TURN, 3.0)):
        document = Document(random_scene())
        document.apply(MoveInstances((2,), (1.0, 0.0, 0.0)))
        document.apply(turn)
        bounds = compute_middle_bounds(document.compute_means(document.find_rows((2,))))
        np.testing.assert_allclose(document.scene.table[2].bounds, bounds, atol=1e-5)


def test_a_frozen_copy_knows_how_the_scene_was_turned():
    document = Document(random_scene())
    document.apply(TurnScene(ANY_TURN))
    np.testing.assert_array_equal(freeze_document(document).orientation, document.orientation)


def test_drives_are_scaled_with_the_street():
    document = Document(random_scene())
    before = {time: world_means(document, time) for time in (0.0, 0.13, 0.31)}
    lengths = [track.compute_path_length() for track in document.scene.actors]
    edit = TurnScene(ANY_TURN, 2.5)
    document.apply(edit)
    for time, means in before.items():
        np.testing.assert_allclose(world_means(document, time), means @ edit.linear.T, atol=1e-4)
    assert [track.compute_path_length() for track in document.scene.actors] == pytest.approx(
        [2.5 * each for each in lengths]
    )


def test_turns_add_up_and_a_turn_back_leaves_the_identity():
    document = Document(random_scene())
    scene = bake_document(document)
    for _ in range(4):
        document.apply(TurnScene.make_upright((0.0, -1.0, 0.0)))
    assert not document.transforms.indices.any()
    np.testing.assert_array_equal(document.orientation, np.eye(3, 4))
    assert bake_document(document).gaussians.means.tobytes() == scene.gaussians.means.tobytes()
    cursor = document.history.cursor
    document.apply(TurnScene())
    assert document.history.cursor == cursor


def test_the_shortest_way_up_is_taken():
    rng = np.random.default_rng(5)
    for up in (*(compute_axis_direction(axis) for axis in AXES), *rng.normal(size=(50, 3)), *NEARLY_DOWN):
        rotation, unit = compute_upright_rotation(up), up / np.linalg.norm(up)
        np.testing.assert_allclose(rotation @ unit, [0, 0, 1], atol=1e-9)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) == pytest.approx(1)
        angle = np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))
        assert angle == pytest.approx(np.arccos(np.clip(unit[2], -1, 1)), abs=1e-5)
    for axis in ("+y", "-y", "-z", "+x", "-x"):
        assert compute_upright_rotation(compute_axis_direction(axis)) @ {"-y": [0, 0, 1.0], "+y": [0, 0, -1.0]}.get(
            axis, [0, 1.0, 0]
        ) == pytest.approx([0, 1, 0]), "forward, or back, stays level along y"


def test_titles_say_what_happens():
    assert [edit.title for edit in AXIS_TURNS][3:] == ["Turn the scene, −Y up", "Turn the scene, −Z up"]
    assert TurnScene(scale=0.01).title == "Scale the scene by 0.01"
    assert TurnScene.make_upright((1.0, 0.0, 0.0), 3.0).title == "Turn the scene, +X up, and scale it by 3"
    assert TurnScene(ANY_TURN).title == "Turn the scene"


@pytest.mark.parametrize(
    "values",
    [{"rotation": (0.0, 0.0, 0.0, 0.0)}, {"rotation": [1]}, {"scale": 0.0}, {"scale": float("nan")}, {"scale": 1e9}],
)
def test_what_is_no_turn_is_refused(values):
    with pytest.raises(EditError):
        edit_from_json({"kind": "turn_scene", **values})
    with pytest.raises(EditError):
        TurnScene.make_upright((0.0, 0.0, 0.0))


def test_a_scene_without_anything_can_be_turned():
    scene = random_scene(actors=0)
    bare = Document(replace(scene, sky=None, views=()))
    bare.apply(AXIS_TURNS[0])
    assert len(freeze_at_time(bake_document(bare), 0.0)) == len(scene)
    assert matrix_from_quaternion(np.array(AXIS_TURNS[0].rotation)).shape == (3, 3)
