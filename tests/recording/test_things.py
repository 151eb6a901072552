"""Boxes of things: where they come from, and that they move with edits."""

import math

import numpy as np
import pytest
from procedural_street import FIRST_CAR, procedural_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.recording.boxes import place_boxes
from instdrive_core.recording.things import find_boxed_things, find_moves, is_stuff, label_groups
from instdrive_core.scene.track import Track


@pytest.fixture
def scene():
    return procedural_street(0.3)


def find_one(scene, instance, **known):
    return next(box for box in place_boxes(scene, find_boxed_things(scene, **known), 0.0) if is_of(box, instance))


def is_of(box, instance):
    return box.thing.instance.id == instance


def annotate(scene, instance):
    """A standing annotated box a little larger than what the splats show."""
    fitted = find_one(scene, instance)
    times, poses = np.array([0.0]), fitted.world_from_box[None]
    return Track("note", "Car", fitted.thing.dimensions + 0.2, times, poses, False)


def test_roads_and_houses_have_no_box(scene):
    boxed = {thing.instance.id for thing in find_boxed_things(scene)}
    assert FIRST_CAR in boxed
    assert not boxed & {instance.id for instance in scene.table if is_stuff(instance)}
    assert any(is_stuff(instance) for instance in scene.table)


def test_a_standing_car_is_fitted_to_its_splats_along_its_longer_side(scene):
    box = find_one(scene, FIRST_CAR)
    assert box.thing.source == "splats"
    assert not box.thing.heads
    width, length, _ = box.thing.dimensions
    assert length > width
    assert not box.velocity.any()


def test_an_annotated_box_wins_and_moves_along_with_the_edit(scene):
    track = annotate(scene, FIRST_CAR)
    document = Document(scene)
    before = find_one(scene, FIRST_CAR, annotated=(track,))
    assert before.thing.source == "annotation"
    np.testing.assert_allclose(before.thing.dimensions, track.dimensions)
    turn = (math.cos(0.3), 0.0, 0.0, math.sin(0.3))
    document.apply(MoveInstances((FIRST_CAR,), (3.0, 1.0, 0.0), turn, 1.5))
    moves = find_moves(document)
    assert set(moves) == {FIRST_CAR}
    after = find_one(bake_document(document), FIRST_CAR, moves=moves, annotated=(track,))
    assert after.thing.source == "annotation"
    np.testing.assert_allclose(after.thing.dimensions, 1.5 * track.dimensions, rtol=1e-6)
    fitted = find_one(bake_document(document), FIRST_CAR)
    np.testing.assert_allclose(after.world_from_box[:3, 3], fitted.world_from_box[:3, 3], atol=0.3)
    turned = after.world_from_box[:3, :3] @ before.world_from_box[:3, :3].T
    assert math.atan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.6, abs=1e-6)


def test_an_annotation_somewhere_else_is_not_taken(scene):
    track = annotate(scene, FIRST_CAR)
    away = track.world_from_box.copy()
    away[:, :3, 3] += [0, 0, 30]
    elsewhere = Track("note", "Car", track.dimensions, track.times, away, False)
    assert find_one(scene, FIRST_CAR, annotated=(elsewhere,)).thing.source == "splats"


def test_a_moved_actor_has_its_moved_track_as_box(scene):
    node = 1
    actor = next(entry.id for entry in scene.table if entry.node == node)
    before = find_one(scene, actor)
    assert before.thing.source == "track"
    assert np.linalg.norm(before.velocity) > 0.5
    document = Document(scene)
    document.apply(MoveInstances((actor,), (2.0, 0.0, 0.0)))
    after = find_one(bake_document(document), actor, moves=find_moves(document))
    np.testing.assert_allclose(after.world_from_box[:3, 3] - before.world_from_box[:3, 3], [2, 0, 0], atol=1e-6)


def test_groups_name_the_splats_that_shape_things(scene):
    things = find_boxed_things(scene)
    groups = label_groups(things, len(scene))
    for place, thing in enumerate(things):
        np.testing.assert_array_equal(np.flatnonzero(groups == place), np.sort(thing.rows))
        assert (scene.instance_ids[thing.rows] == thing.instance.id).all()
