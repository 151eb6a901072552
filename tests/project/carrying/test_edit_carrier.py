"""Every kind of edit, carried over to a scene that has grown: what came of a splat has what was done to it."""

from copy import deepcopy

import numpy as np
import pytest
from document_snapshot import snapshot
from edit_cases import CAR, EXAMPLES, PAIR, TAXI, rich_document
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.edits.serialize import edit_from_json, edits_from_lines, edits_to_lines
from instdrive_core.instances.table import build_instance_table
from instdrive_core.project.carrying.edit_carrier import EditCarrier
from instdrive_core.project.carrying.edited_rows import find_edited_rows
from instdrive_core.project.carrying.row_origins import RowOrigins
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag

LOOKS_ANEW = {"fill_hole", "complete_instance"}
"""Kinds that replace rows by what they find on the better splats."""


@pytest.fixture
def plain():
    """The rich document's scene without edits, and those edits."""
    document = rich_document()
    edits = [edit.copy_undone() for edit in document.history.edits]
    while document.undo():
        pass
    return document.scene, edits


def open_document(scene):
    document = Document(scene)
    document.open_scene = lambda path: random_scene(seed=1, count=15, instances=2, actors=1)
    return document


def grow(scene):
    """Every third splat has one more beside it, a millimetre away; returns the scene and each row's parent."""
    parents = np.concatenate([np.arange(len(scene)), np.arange(0, len(scene), 3)])
    gaussians = scene.gaussians.select(parents)
    gaussians.means[len(scene) :] += np.float32(0.001)
    ids, nodes = scene.instance_ids[parents], scene.nodes[parents]
    names = {entry.id: entry.name for entry in scene.table}
    classes = {entry.id: entry.class_name for entry in scene.table}
    grown = Scene(
        gaussians,
        ids,
        scene.codewords[parents],
        nodes,
        build_instance_table(ids, gaussians.means, scene.codewords[parents], nodes, names, classes),
        scene.actors,
        scene.sky,
        scene.views,
        scene.origin,
        scene.code_bits,
        {name: column[parents] for name, column in scene.extra.items()},
        scene.exposures,
    )
    return grown, parents


def carry(scene, edits):
    """Both documents after all edits, the parents, what the edits became, and the carrier."""
    grown, parents = grow(scene)
    old, new = open_document(deepcopy(scene)), open_document(deepcopy(grown))
    carrier = EditCarrier(old, new, RowOrigins(parents, len(scene)))
    carried = [carrier.carry(edit) for edit in edits]
    return old, new, parents, [edit for edit in carried if edit is not None], carrier, grown


@pytest.mark.parametrize("kind", EXAMPLES)
def test_what_grew_has_what_was_done_to_its_parent(plain, kind):
    scene, edits = plain
    edits.append(edit_from_json({"kind": kind, **EXAMPLES[kind]}))
    old, new, parents, carried, carrier, grown = carry(scene, edits)
    assert not carrier.left_out
    rows = len(parents)
    np.testing.assert_array_equal(new.scene.instance_ids[:rows], old.scene.instance_ids[parents])
    if kind not in LOOKS_ANEW:
        np.testing.assert_array_equal(new.state.flags[:rows], old.state.flags[parents])
    np.testing.assert_array_equal(new.scene.nodes[:rows], old.scene.nodes[parents])
    assert {(entry.id, entry.name, entry.class_name, entry.node) for entry in new.scene.table} == {
        (entry.id, entry.name, entry.class_name, entry.node) for entry in old.scene.table
    }
    if kind not in ("paint_instances", "adjust_instances"):
        ours, theirs = new.colors.values[new.colors.indices[:rows]], old.colors.values[old.colors.indices[parents]]
        np.testing.assert_allclose(ours, theirs, atol=0.02)
    ours, theirs = (part.transforms.matrices[part.transforms.indices] for part in (new, old))
    np.testing.assert_allclose(ours[:rows], theirs[parents], atol=1e-9)

    replayed = open_document(deepcopy(grown))
    for edit in edits_from_lines(edits_to_lines(carried)):
        replayed.apply(edit)
    assert snapshot(replayed) == snapshot(new)
    while replayed.undo():
        pass
    assert snapshot(replayed) == snapshot(open_document(deepcopy(grown)))


def test_instances_made_by_edits_keep_their_numbers_and_later_edits_find_them(plain):
    scene, _ = plain
    first = Document(deepcopy(scene)).first_free_id
    edits = [
        SplitInstance(PAIR, 0.5),
        DuplicateInstances((CAR,), (0.0, 4.0, 0.0)),
        CompoundEdit((RenameInstance(first + 1, "twin"), MoveInstances((first + 1,), (0.0, 0.5, 0.0))), "two"),
        DeleteInstances((first, TAXI)),
    ]
    old, new, parents, carried, carrier, _ = carry(scene, edits)
    assert not carrier.left_out
    assert [edit.title for edit in carried] == [edit.title for edit in edits]
    assert new.scene.table[first + 1].name == "twin"
    assert new.summarize_instance(first).is_deleted
    deleted = new.state.find_mask(Flag.DELETED)[: len(parents)]
    np.testing.assert_array_equal(deleted, old.state.find_mask(Flag.DELETED)[parents])


def test_an_edit_that_cannot_be_done_is_named_and_the_others_mean_the_same(plain):
    scene, _ = plain
    first = Document(deepcopy(scene)).first_free_id
    grown, parents = grow(scene)
    old, new = open_document(deepcopy(scene)), Document(deepcopy(grown))  # which opens no files
    carrier = EditCarrier(old, new, RowOrigins(parents, len(scene)))
    assert carrier.carry(edit_from_json({"kind": "insert_scene", "path": "other.ply"})) is None
    assert carrier.carry(DuplicateInstances((CAR,), (0.0, 4.0, 0.0))) is not None
    assert carrier.carry(DeleteInstances((first,))) is None
    assert carrier.carry(DeleteInstances((old.first_free_id - 1,))) == DeleteInstances((first,))
    assert "Insert other.ply" in carrier.left_out[0]
    assert new.summarize_instance(first).is_deleted  # the copy's number, since nothing was inserted
    assert not new.summarize_instance(CAR).is_deleted


def test_what_is_deleted_moved_painted_or_drives_elsewhere_counts_as_edited(plain):
    scene, _ = plain
    document = open_document(scene)
    count = len(scene)
    for kind, instances in (("turn_scene", ()), ("select_all", ()), ("rename_instance", ())):
        document.apply(edit_from_json({"kind": kind, **EXAMPLES[kind]}))
        assert not find_edited_rows(document, count).any(), instances
    for kind, instances in (
        ("delete_instances", (PAIR, TAXI)),
        ("move_instances", (CAR,)),
        ("recolor_instances", (CAR, 5)),
    ):
        document.apply(edit_from_json({"kind": kind, **EXAMPLES[kind]}))
        assert find_edited_rows(document, count)[np.isin(scene.instance_ids, instances)].all()
        document.undo()
    document.apply(edit_from_json({"kind": "set_path", **EXAMPLES["set_path"]}))
    np.testing.assert_array_equal(find_edited_rows(document, count), scene.nodes == 1)
