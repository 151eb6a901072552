"""Parts of an edited scene as scenes of their own."""

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.queries.bake import bake_document, freeze_at_time
from instdrive_core.edits.queries.scene_parts import (
    bake_actor,
    bake_part,
    find_remaining_actors,
    find_selected_actors,
    find_selected_rows,
)
from instdrive_core.errors import EditError


@pytest.fixture
def document():
    """Instance 3 recoloured and moved, 1 deleted; instances 7 and 8 are the actors."""
    made = Document(random_scene())
    made.apply(RecolorInstances((3,), "solid", (1.0, 0.25, 0.0)))
    made.apply(MoveInstances((3,), (1.0, 2.0, 0.5)))
    made.apply(DeleteInstances((1,)))
    return made


def test_a_part_is_what_the_whole_has_of_it(document):
    document.apply(SelectInstances((3, 8)))
    part, whole = bake_part(document, find_selected_rows(document)), bake_document(document)
    rows = np.flatnonzero(np.isin(whole.instance_ids, [3, 8]))
    for name, array in part.gaussians.arrays().items():
        assert array.tobytes() == getattr(whole.gaussians, name)[rows].tobytes(), name
    np.testing.assert_array_equal(part.instance_ids, whole.instance_ids[rows])
    assert {instance.id for instance in part.table} == {3, 8}
    assert (part.table[3], part.table[8].name) == (whole.table[3], whole.table[8].name)
    assert part.sky is None
    assert part.views == document.scene.views
    np.testing.assert_array_equal(part.origin, document.scene.origin)


def test_a_part_keeps_the_tracks_of_its_own_splats_only(document):
    part = bake_part(document, document.find_rows((3, 8)))
    assert part.actors == (document.scene.actors[1],)
    np.testing.assert_array_equal(part.nodes, (part.instance_ids == 8).astype(np.uint16))
    assert (part.table[8].node, part.table[3].node) == (1, 0)
    assert bake_part(document, document.find_rows((3,))).actors == ()
    at_once, later = bake_part(document, document.find_rows((3, 8)), 0.3), freeze_at_time(part, 0.3)
    np.testing.assert_array_equal(at_once.gaussians.means, later.gaussians.means)


def test_deleted_splats_and_absent_actors_are_in_no_part(document):
    assert not len(bake_part(document, document.find_rows((1,))))
    assert not len(bake_part(document, document.find_rows((7, 8)), 9.0))
    with pytest.raises(EditError, match="nothing is selected"):
        find_selected_rows(document)


@pytest.mark.parametrize("node", [1, 2])
def test_an_actor_alone_placed_by_its_track_is_the_actor_in_the_scene(document, node):
    alone = bake_actor(document, node)
    assert (alone.actors, alone.views, alone.sky) == ((), (), None)
    assert not alone.nodes.any()
    assert not alone.origin.any()
    time = 0.3
    world, rows = bake_document(document, time), document.find_rows((6 + node,))
    pose = document.scene.actors[node - 1].interpolate_pose(time)
    placed = alone.gaussians.means @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose(placed, world.gaussians.means[world.instance_ids == 6 + node], atol=1e-4)
    assert alone.gaussians.sh_rest.tobytes() == document.scene.gaussians.sh_rest[rows].tobytes()
    assert alone.table[6 + node].count == len(alone)


def test_which_actors_are_there_and_selected(document):
    assert find_remaining_actors(document) == (1, 2)
    document.apply(SelectInstances((3, 8)))
    assert find_selected_actors(document) == (2,)
    document.apply(DeleteInstances((8,)))
    assert find_remaining_actors(document) == (1,)
    for node, told in ((2, "nothing is left of actor 2"), (3, "no actor 3"), (0, "no actor 0")):
        with pytest.raises(EditError, match=told):
            bake_actor(document, node)
