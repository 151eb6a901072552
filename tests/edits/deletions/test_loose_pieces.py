"""What hung in a deleted tree does not stay in the air."""

from dataclasses import replace

import numpy as np
import pytest
from parked_street import PAVEMENT, WALL, scene_of

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.deletions.loose_pieces import find_loose_pieces
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.scene.selection import Flag

TREE = 9
TWIGS = 30


def tree_street(twigs=TWIGS, at=(0.0, 0.0, 4.0)):
    """A tree of 4 m before a wall 3 m behind it, some of whose twigs are the wall's; the rows of those."""
    rng = np.random.default_rng(4)
    crown = rng.normal(0, 1, (1500, 3))
    crown = crown / np.linalg.norm(crown, axis=1)[:, None] * 1.5 + [0, 0, 4]
    trunk = np.c_[rng.uniform(-0.1, 0.1, (200, 2)), rng.uniform(0, 2.5, 200)]
    wall = np.stack(np.meshgrid([4.5], np.arange(-10, 10, 0.2), np.arange(0, 6, 0.2)), -1).reshape(-1, 3)
    ground = np.stack(np.meshgrid(np.arange(-4, 4.5, 0.2), np.arange(-6, 6, 0.2), [0.0]), -1).reshape(-1, 3)
    hung = rng.uniform(-0.12, 0.12, (twigs, 3)) + at
    parts = [(crown, TREE), (trunk, TREE), (wall, WALL), (ground, PAVEMENT), (hung, WALL)]
    means = np.concatenate([points for points, _ in parts])
    ids = np.repeat([number for _, number in parts], [len(points) for points, _ in parts])
    document = Document(scene_of(rng, means, ids, np.full((len(means), 3), 0.5), ()))
    return document, np.arange(len(means) - twigs, len(means))


def find(document):
    return find_loose_pieces(document, document.find_rows((TREE,)))


def test_twigs_with_the_label_of_the_wall_go_with_the_tree():
    document, twigs = tree_street(at=(1.5, 0.0, 4.0))
    document.apply(DeleteInstances((TREE,)))
    np.testing.assert_array_equal(find(document), twigs)
    assert np.isin(twigs, report_deletion(document, (TREE,), 0.0).residue).all()


@pytest.mark.parametrize(
    ("twigs", "at"),
    [
        (TWIGS, (4.2, 0.0, 4.0)),  # a balcony
        (TWIGS, (1.5, 0.0, 7.0)),  # a lamp above the crown
        (400, (1.5, 0.0, 4.0)),  # as large as a thing of its own
        (TWIGS, (0.2, 0.0, 0.1)),  # at the foot of the trunk
    ],
)
def test_what_is_no_scrap_of_the_tree_stays(twigs, at):
    assert not len(find(tree_street(twigs, at)[0]))


def test_twigs_are_found_in_a_scene_that_was_turned_and_scaled():
    document, twigs = tree_street(at=(1.5, 0.0, 4.0))
    scene = document.scene
    lying, gaussians = scene.gaussians.means[:, [0, 2, 1]] * 100, scene.gaussians
    gaussians = replace(
        gaussians, means=lying * np.float32([1, -1, 1]), log_scales=gaussians.log_scales + np.float32(np.log(100))
    )
    document = Document(replace(scene, gaussians=gaussians))
    document.apply(TurnScene.make_upright((0.0, -1.0, 0.0), 0.01))
    np.testing.assert_array_equal(find(document), twigs)


def test_locked_twigs_stay():
    document, twigs = tree_street(at=(1.5, 0.0, 4.0))
    document.state.change(twigs, Flag.LOCKED, True)
    assert not len(find(document))


def test_the_wall_has_no_loose_pieces():
    document, _ = tree_street(0)
    assert not len(find_loose_pieces(document, document.find_rows((WALL,))))
