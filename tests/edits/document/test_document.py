"""Every edit through `Document.apply`: what it changes, what it spares, and that undo restores every bit."""

import json

import numpy as np
import pytest
from document_snapshot import snapshot
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.classes import SetInstanceClass
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteRows, DeleteSelected
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.select import SelectCodeword, SelectInstances, SelectNone
from instdrive_core.edits.kinds.visibility import HideInstances, LockInstances, ShowAll
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import EditError
from instdrive_core.scene.selection import Flag


@pytest.fixture
def document():
    return Document(random_scene())


def flagged(document, flag):
    return set(document.state.find_rows(flag).tolist())


def rows(document, *ids):
    return set(np.flatnonzero(np.isin(document.scene.instance_ids, ids)).tolist())


# Selecting


def test_selecting_replaces_adds_and_removes(document):
    document.apply(SelectInstances((2,)))
    assert flagged(document, Flag.SELECTED) == rows(document, 2)
    document.apply(SelectInstances((3, 1), "add"))
    assert document.find_selected_instances() == (1, 2, 3)
    document.apply(SelectInstances((2,), "remove"))
    assert document.find_selected_instances() == (1, 3)
    document.apply(SelectInstances((4,)))
    assert document.find_selected_instances() == (4,)
    document.apply(SelectNone())
    assert document.find_selected_instances() == ()


def test_codeword_selection_crosses_instances(document):
    document.apply(SelectCodeword(11))
    carriers = np.flatnonzero(document.scene.codewords == 11)
    assert flagged(document, Flag.SELECTED) == set(carriers.tolist())
    assert len(document.find_selected_instances()) > 1
    with pytest.raises(EditError, match="codeword 999"):
        document.apply(SelectCodeword(999))


def test_hidden_locked_and_deleted_splats_are_not_selected(document):
    document.apply(HideInstances((1,)))
    document.apply(LockInstances((2,)))
    document.apply(DeleteInstances((3,)))
    document.apply(SelectInstances((1, 2, 3, 4)))
    assert document.find_selected_instances() == (4,)
    document.apply(HideInstances((4,)))
    assert document.find_selected_instances() == (), "what is hidden leaves the selection"


def test_selecting_the_same_again_is_no_step(document):
    document.apply(SelectInstances((2,)))
    document.apply(SelectInstances((2,)))
    document.apply(SelectInstances((2,), "add"))
    assert document.history.cursor == 1


# Deleting, hiding, locking


def test_delete_selected_and_undo(document):
    document.apply(SelectInstances((2, 5)))
    before = snapshot(document)
    document.apply(DeleteSelected())
    assert flagged(document, Flag.DELETED) == rows(document, 2, 5)
    assert flagged(document, Flag.SELECTED) == set()
    document.undo()
    assert snapshot(document) == before
    document.apply(SelectNone())
    with pytest.raises(EditError, match="nothing is selected"):
        document.apply(DeleteSelected())


def test_delete_rows_replays_from_runs(document):
    document.apply(LockInstances((2,)))
    locked = rows(document, 2)
    wanted = np.array(sorted({0, 1, 2, 7, *locked}))
    document.apply(DeleteRows(wanted))
    assert flagged(document, Flag.DELETED) == set(wanted.tolist()) - locked
    again = edit_from_json(json.loads(json.dumps(document.history.edits[-1].to_json())))
    assert again == document.history.edits[-1]
    document.undo()
    assert flagged(document, Flag.DELETED) == set()
    with pytest.raises(EditError, match="beyond the scene"):
        document.apply(DeleteRows(np.array([len(document.scene)])))


def test_locked_instances_are_spared(document):
    document.apply(LockInstances((2,)))
    document.apply(DeleteInstances((2, 3)))
    assert flagged(document, Flag.DELETED) == rows(document, 3)
    for edit in (DeleteInstances((2,)), RecolorInstances((2,), "solid", (1.0, 0.0, 0.0))):
        with pytest.raises(EditError, match="unlock it first"):
            document.apply(edit)
    with pytest.raises(EditError, match="deleted already"):
        document.apply(DeleteInstances((3,)))
    document.apply(LockInstances((2,), False))
    document.apply(DeleteInstances((2,)))
    assert flagged(document, Flag.DELETED) == rows(document, 2, 3)


def test_hide_show_and_show_all(document):
    document.apply(HideInstances((1, 2)))
    assert set(document.find_visible_instances()) == {3, 4, 5, 6, 7, 8}
    document.apply(HideInstances((1,), False))
    assert document.summarize_instance(2).is_hidden
    assert not document.summarize_instance(1).is_hidden
    document.apply(ShowAll())
    assert document.state.drawn.all()


# Recolouring


def test_each_tinted_instance_has_its_own_entry_and_solid_ones_share(document):
    document.apply(RecolorInstances((1, 2), "tint", (0.2, 0.4, 0.6)))
    assert len(document.colors) == 3
    document.apply(RecolorInstances((1, 2), "solid", (0.2, 0.4, 0.6)))
    assert len(document.colors) == 4
    entries = document.colors.indices
    assert {entries[row] for row in rows(document, 1, 2)} == {3}
    assert not entries[sorted(set(range(200)) - rows(document, 1, 2))].any()
    document.undo()
    document.undo()
    assert len(document.colors) == 1


def test_tint_moves_the_mean_to_the_color_and_keeps_relative_brightness(document):
    scene = document.scene
    scene.gaussians.sh_dc[:] = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    document.apply(RecolorInstances((1,), "tint", (0.6, 0.3, 0.1)))
    members = np.flatnonzero(scene.instance_ids == 1)
    colors = 0.5 + 0.28209479177387814 * scene.gaussians.sh_dc[members]
    matrix = document.colors.matrices[document.colors.indices[members[0]]]
    shown = colors @ matrix[:, :3].T + matrix[:, 3]
    weights = scene.gaussians.opacities[members]
    np.testing.assert_allclose(np.average(shown, axis=0, weights=weights), [0.6, 0.3, 0.1], rtol=1e-4)
    luma = colors @ [0.2126, 0.7152, 0.0722]
    np.testing.assert_allclose(shown[:, 0] / shown[0, 0], luma / luma[0], rtol=1e-4)


def test_tint_of_a_black_instance_is_bounded(document):
    document.scene.gaussians.sh_dc[:] = -5
    document.apply(RecolorInstances((1,), "tint", (1.0, 1.0, 1.0)))
    assert np.abs(document.colors.matrices).max() <= 20


@pytest.mark.parametrize("color", [(0.0, 1.1, 0.0), (-0.1, 0.0, 0.0), (float("nan"), 0.0, 0.0)])
def test_colors_outside_the_cube_are_refused(color):
    with pytest.raises(EditError, match="from 0 to 1"):
        RecolorInstances((1,), "tint", color)


def test_a_slider_drag_is_one_step(document):
    for step in range(5):
        document.apply(RecolorInstances((1,), "solid", (step / 5, 0.0, 0.0)), gesture="slider")
    assert document.history.cursor == 1
    assert len(document.colors) == 2
    document.undo()
    assert not document.colors.indices.any()


# Instances


def test_rename_and_class(document):
    version = document.versions.table
    document.apply(RenameInstance(3, " tram "))
    document.apply(SetInstanceClass(3, "Rail"))
    assert (document.scene.table[3].name, document.scene.table[3].class_name) == ("tram", "Rail")
    assert document.versions.table == version + 2
    document.undo()
    document.undo()
    assert document.scene.table[3].name == "instance 3"
    for name in ("", "two\nlines", "x" * 201):
        with pytest.raises(EditError):
            RenameInstance(3, name)


def test_merge_gives_all_splats_to_one(document):
    before, union = snapshot(document), rows(document, 1, 2, 3)
    document.apply(MergeInstances((1, 2, 3), 2))
    assert rows(document, 2) == union
    assert set(document.find_rows([2]).tolist()) == union
    assert document.scene.table[2].count == len(union)
    assert 1 not in document.scene.table
    means = document.scene.gaussians.means[sorted(union)]
    np.testing.assert_array_equal(document.scene.table[2].bounds, [means.min(axis=0), means.max(axis=0)])
    with pytest.raises(EditError, match="instance 1"):
        document.apply(SelectInstances((1,)))
    document.undo()
    assert snapshot(document) == before
    assert set(document.find_rows([1]).tolist()) == rows(document, 1)


def test_merging_across_tracks_is_refused(document):
    with pytest.raises(EditError, match="another object"):
        document.apply(MergeInstances((7,), 1))


# The document


def test_unknown_instances_are_named(document):
    for edit in (DeleteInstances((1, 77)), SelectInstances((77,)), HideInstances((77,)), RenameInstance(77, "x")):
        with pytest.raises(EditError, match="77"):
            document.apply(edit)
    assert document.history.cursor == 0
    with pytest.raises(EditError, match="77"):
        document.summarize_instance(77)


def test_summaries_count_splats(document):
    document.apply(SelectInstances((1,)))
    document.state.change(np.array(sorted(rows(document, 1)))[:3], Flag.HIDDEN, True)
    summary = document.summarize_instance(1)
    count = len(rows(document, 1))
    assert (summary.count, summary.hidden, summary.selected, summary.drawn) == (count, 3, count, count - 3)
    assert summary.selected > 0
    assert not summary.is_hidden
    document.apply(DeleteInstances((1,)))
    summary = document.summarize_instance(1)
    assert summary.is_deleted
    assert not any((summary.is_hidden, summary.is_locked, summary.selected))


def test_versions_rise_only_with_changes(document):
    versions = (document.versions.states, document.versions.colors, document.versions.table)
    document.apply(SelectInstances((1,)))
    assert document.versions.states > versions[0]
    assert (document.versions.colors, document.versions.table) == versions[1:]
    document.apply(RecolorInstances((1,), "solid", (1.0, 0.0, 0.0)))
    assert document.versions.colors > versions[1]
    version = document.versions.colors
    document.undo()
    assert document.versions.colors > version


def test_edits_remember_only_what_they_touch():
    document = Document(random_scene(count=20_000, instances=2_000))
    document.apply(SelectInstances((5,)))
    edit = DeleteInstances((5,))
    document.apply(edit)
    held = sum(change.rows.nbytes for change in edit._done)
    assert held == 2 * 4 * len(rows(document, 5)), "two flags, four bytes a row"
