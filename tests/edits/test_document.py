"""Every edit through `Document.apply`: what it changes, what it spares, and that undo restores every bit."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scene import random_scene

from instdrive_core.edits.color import RecolorInstances
from instdrive_core.edits.delete import DeleteInstances, DeleteRows, DeleteSelected
from instdrive_core.edits.document import Document
from instdrive_core.edits.instances import MergeInstances, RenameInstance, SetInstanceClass
from instdrive_core.edits.select import SelectCodeword, SelectInstances, SelectNone
from instdrive_core.edits.serialize import EDITS, edit_from_json, edits_from_lines, edits_to_lines
from instdrive_core.edits.visibility import HideInstances, LockInstances, ShowAll
from instdrive_core.errors import EditError
from instdrive_core.scene.selection import Flag


@pytest.fixture
def document():
    return Document(random_scene())


def snapshot(document):
    """Everything an edit may change, as bytes and values."""
    arrays = [document.state.flags, document.colors.indices, document.colors.matrices, document.colors.alphas]
    arrays += [document.transforms.indices, document.transforms.values]
    arrays += [document.scene.instance_ids, *document.scene.gaussians.arrays().values()]
    arrays += [array for track in document.scene.actors for array in (track.world_from_box, track.dimensions)]
    return [array.tobytes() for array in arrays], list(document.scene.table), document.first_free_id


def flagged(document, flag):
    return set(document.state.rows_with(flag).tolist())


def rows(document, *ids):
    return set(np.flatnonzero(np.isin(document.scene.instance_ids, ids)).tolist())


# Selecting


def test_selecting_replaces_adds_and_removes(document):
    document.apply(SelectInstances((2,)))
    assert flagged(document, Flag.SELECTED) == rows(document, 2)
    document.apply(SelectInstances((3, 1), "add"))
    assert document.selected_instances() == (1, 2, 3)
    document.apply(SelectInstances((2,), "remove"))
    assert document.selected_instances() == (1, 3)
    document.apply(SelectInstances((4,)))
    assert document.selected_instances() == (4,)
    document.apply(SelectNone())
    assert document.selected_instances() == ()


def test_codeword_selection_crosses_instances(document):
    document.apply(SelectCodeword(11))
    carriers = np.flatnonzero(document.scene.codewords == 11)
    assert flagged(document, Flag.SELECTED) == set(carriers.tolist())
    assert len(document.selected_instances()) > 1
    with pytest.raises(EditError, match="codeword 999"):
        document.apply(SelectCodeword(999))


def test_hidden_locked_and_deleted_splats_are_not_selected(document):
    document.apply(HideInstances((1,)))
    document.apply(LockInstances((2,)))
    document.apply(DeleteInstances((3,)))
    document.apply(SelectInstances((1, 2, 3, 4)))
    assert document.selected_instances() == (4,)
    document.apply(HideInstances((4,)))
    assert document.selected_instances() == (), "what is hidden leaves the selection"


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
    assert set(document.visible_instances()) == {3, 4, 5, 6, 7, 8}
    document.apply(HideInstances((1,), False))
    assert document.instance_flags(2).is_hidden
    assert not document.instance_flags(1).is_hidden
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
    version = document.table_version
    document.apply(RenameInstance(3, " tram "))
    document.apply(SetInstanceClass(3, "Rail"))
    assert (document.scene.table[3].name, document.scene.table[3].class_name) == ("tram", "Rail")
    assert document.table_version == version + 2
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
    assert set(document.rows_of([2]).tolist()) == union
    assert document.scene.table[2].count == len(union)
    assert 1 not in document.scene.table
    means = document.scene.gaussians.means[sorted(union)]
    np.testing.assert_array_equal(document.scene.table[2].bounds, [means.min(axis=0), means.max(axis=0)])
    with pytest.raises(EditError, match="instance 1"):
        document.apply(SelectInstances((1,)))
    document.undo()
    assert snapshot(document) == before
    assert set(document.rows_of([1]).tolist()) == rows(document, 1)


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
        document.instance_flags(77)


def test_summaries_count_splats(document):
    document.apply(SelectInstances((1,)))
    document.state.change(np.array(sorted(rows(document, 1)))[:3], Flag.HIDDEN, True)
    summary = document.instance_flags(1)
    count = len(rows(document, 1))
    assert (summary.count, summary.hidden, summary.selected, summary.drawn) == (count, 3, count, count - 3)
    assert summary.selected > 0
    assert not summary.is_hidden
    document.apply(DeleteInstances((1,)))
    summary = document.instance_flags(1)
    assert summary.is_deleted
    assert not any((summary.is_hidden, summary.is_locked, summary.selected))


def test_versions_rise_only_with_changes(document):
    versions = (document.state.version, document.colors.version, document.table_version)
    document.apply(SelectInstances((1,)))
    assert document.state.version > versions[0]
    assert (document.colors.version, document.table_version) == versions[1:]
    document.apply(RecolorInstances((1,), "solid", (1.0, 0.0, 0.0)))
    assert document.colors.version > versions[1]
    version = document.colors.version
    document.undo()
    assert document.colors.version > version


def test_edits_remember_only_what_they_touch():
    document = Document(random_scene(count=20_000, instances=2_000))
    document.apply(SelectInstances((5,)))
    edit = DeleteInstances((5,))
    document.apply(edit)
    held = sum(change.rows.nbytes for change in edit._done)
    assert held == 2 * 4 * len(rows(document, 5)), "two flags, four bytes a row"


# Properties over random sequences of edits


def entries(kind, **parameters):
    """Edits as JSON: making them while hypothesis draws would let beartype's random checks disturb it."""
    return st.fixed_dictionaries({"kind": st.just(kind), **parameters})


ids = st.lists(st.integers(1, 9), min_size=1, max_size=3)
modes = st.sampled_from(["replace", "add", "remove", "intersect"])
channels = st.sampled_from([0.0, 0.25, 1.0])
simple_edits = st.one_of(
    entries("select_instances", ids=ids, mode=modes),
    entries("select_codeword", codeword=st.integers(9, 13), mode=modes),
    entries("select_none"),
    entries("select_all"),
    entries("invert_selection"),
    entries("select_class", class_name=st.sampled_from(["", "Car"]), mode=modes),
    entries("select_rows", rows=st.sampled_from([[], [[3, 9]], [[0, 1], [20, 40]], [[50, 30]]]), mode=modes),
    entries("grow_selection", distance=st.sampled_from([None, 0.5, 2.0]), time=st.sampled_from([0.0, 0.3])),
    entries("shrink_selection", distance=st.sampled_from([None, 0.5, 2.0])),
    entries("delete_instances", ids=ids),
    entries("delete_selected"),
    entries("hide_instances", ids=ids, hidden=st.booleans()),
    entries("lock_instances", ids=ids, locked=st.booleans()),
    entries("show_all"),
    entries(
        "recolor_instances",
        ids=ids,
        mode=st.sampled_from(["tint", "solid"]),
        color=st.lists(channels, min_size=3, max_size=3),
    ),
    st.sampled_from(
        [("hue", 40.0), ("contrast", 1.5), ("temperature", -0.5), ("opacity", 0.5), ("saturation", 1.0)]
    ).flatmap(lambda pair: entries("adjust_instances", ids=ids, what=st.just(pair[0]), amount=st.just(pair[1]))),
    entries("rename_instance", id=st.integers(1, 9), name=st.sampled_from(["car", "bus"])),
    entries("set_instance_class", id=st.integers(1, 9), class_name=st.sampled_from(["", "Car"])),
    entries("merge_instances", ids=ids, into=st.integers(1, 9)),
    entries("split_instance", id=st.integers(1, 9), gap=st.sampled_from([0.25, 1.5])),
    entries("reassign_selected", into=st.sampled_from([None, 0, 1, 7])),
    entries("absorb_floaters", id=st.integers(1, 10)),
    entries(
        "move_instances",
        ids=ids,
        translation=st.sampled_from([[0.0, 0.0, 0.0], [1.0, -2.0, 0.5]]),
        rotation=st.sampled_from([[1.0, 0.0, 0.0, 0.0], [0.5, 0.1, 0.2, -0.7]]),
        scale=st.sampled_from([1.0, 1.5]),
        yaw_only=st.booleans(),
        along_lane=st.booleans(),
        on_ground=st.booleans(),
    ),
    entries("duplicate_instances", ids=ids, translation=st.sampled_from([[0.0, 0.0, 0.0], [1.0, 2.0, 0.0]])),
    entries("insert_scene", path=st.just("other.ply")),
)
edits = simple_edits | entries("compound", edits=st.lists(simple_edits, max_size=3), name=st.just("several"))


def small_document():
    document = Document(random_scene(count=60))
    document.open_scene = lambda path: random_scene(seed=1, count=15, instances=2, actors=1)
    return document


@settings(deadline=None)
@given(st.lists(st.tuples(edits, st.sampled_from([None, None, "drag"])), max_size=12))
def test_undone_and_redone_edits_restore_every_bit(steps):
    document = small_document()
    snapshots = [snapshot(document)]
    for entry, gesture in steps:
        edit = edit_from_json(entry)
        before, cursor = snapshot(document), document.history.cursor
        try:
            document.apply(edit, gesture)
        except EditError:
            assert (snapshot(document), document.history.cursor) == (before, cursor)
        del snapshots[document.history.cursor :]
        snapshots.append(snapshot(document))
        check_invariants(document)
    for expected in reversed(snapshots[:-1]):
        document.undo()
        assert snapshot(document) == expected
        check_invariants(document)
    for expected in snapshots[1:]:
        document.redo()
        assert snapshot(document) == expected
    assert document.redo() is None


def check_invariants(document):
    """Selected splats can be selected, and cached counts are those of a fresh document."""
    flags = document.state.flags
    assert not ((flags & Flag.SELECTED != 0) & (flags & 14 != 0)).any()
    ids = document.scene.instance_ids
    for instance in document.scene.table:
        members = flags[ids == instance.id]
        summary = document.instance_flags(instance.id)
        assert summary.count == instance.count == len(members)
        assert summary.selected == (members & Flag.SELECTED != 0).sum()
        assert summary.drawn == (members & (Flag.HIDDEN | Flag.DELETED) == 0).sum()
    assert document.colors.indices.max() < len(document.colors)
    assert document.transforms.indices.max() < len(document.transforms)


@settings(deadline=None)
@given(st.lists(edits, max_size=8))
def test_serialised_edits_replay_to_the_same_state(steps):
    document = small_document()
    for entry in steps:
        try:
            document.apply(edit_from_json(entry))
        except EditError:
            continue
    lines = edits_to_lines(document.history.done)
    replayed = small_document()
    for edit in edits_from_lines(lines):
        replayed.apply(edit)
    assert snapshot(replayed) == snapshot(document)
    assert replayed.history.done == document.history.done


# Serialisation


def test_every_edit_class_is_registered():
    def descendants(cls):
        return {cls} | {sub for child in cls.__subclasses__() for sub in descendants(child)}

    from instdrive_core.edits.base import Edit

    concrete = {cls for cls in descendants(Edit) if not cls.__abstractmethods__ and "instdrive_core" in cls.__module__}
    assert set(EDITS.values()) == concrete


BAD_ENTRIES = [
    ({"kind": "explode"}, "explode"),
    ({"kind": ["show_all"]}, "show_all"),
    (["delete_instances"], "delete_instances"),
    ({"kind": "delete_instances"}, "ids"),
    ({"kind": "delete_instances", "ids": [1], "force": True}, "force"),
    ({"kind": "delete_instances", "ids": ["1"]}, "'1'"),
    ({"kind": "delete_instances", "ids": [True]}, "True"),
    ({"kind": "delete_instances", "ids": [0]}, "ID 0"),
    ({"kind": "delete_instances", "ids": [[1]]}, "[1]"),
    ({"kind": "delete_instances", "ids": []}, "no instance"),
    ({"kind": "delete_instances", "ids": 3}, "delete_instances"),
    ({"kind": "select_instances", "ids": [1], "mode": "toggle"}, "toggle"),
    ({"kind": "select_codeword", "codeword": -1}, "-1"),
    ({"kind": "select_codeword", "codeword": 1 << 40}, "bits"),
    ({"kind": "select_class", "class_name": 4}, "4"),
    ({"kind": "select_rows", "rows": [0, 1]}, "pairs"),
    ({"kind": "select_rows", "rows": [[5, 1], [2, 1]]}, "rising"),
    ({"kind": "select_rows", "rows": 7}, "7"),
    ({"kind": "select_rows", "rows": [[0, 1]], "mode": "toggle"}, "toggle"),
    ({"kind": "grow_selection", "distance": 0}, "metres above 0"),
    ({"kind": "grow_selection", "distance": True}, "metres above 0"),
    ({"kind": "shrink_selection", "distance": "far"}, "'far'"),
    ({"kind": "shrink_selection", "time": None}, "seconds"),
    ({"kind": "recolor_instances", "ids": [1], "mode": "glow", "color": [0, 0, 0]}, "glow"),
    ({"kind": "recolor_instances", "ids": [1], "mode": "tint", "color": [0, 0]}, "three numbers"),
    ({"kind": "recolor_instances", "ids": [1], "mode": "tint", "color": [0, 0, float("nan")]}, "three numbers"),
    ({"kind": "recolor_instances", "ids": [1], "mode": "tint", "color": "red"}, "red"),
    ({"kind": "rename_instance", "id": 1, "name": 5}, "5"),
    ({"kind": "rename_instance", "id": None, "name": "x"}, "None"),
    ({"kind": "hide_instances", "ids": [1], "hidden": "yes"}, "yes"),
    ({"kind": "lock_instances", "ids": [1], "locked": 1}, "locked"),
    ({"kind": "split_instance", "id": 1, "gap": "wide"}, "wide"),
    ({"kind": "reassign_selected", "into": "1"}, "'1'"),
    ({"kind": "absorb_floaters", "id": 0}, "ID 0"),
    ({"kind": "move_instances", "ids": [1], "translation": [0, 0]}, "translation"),
    ({"kind": "move_instances", "ids": [1], "translation": [0, 0, "x"]}, "translation"),
    ({"kind": "move_instances", "ids": [1], "rotation": [0, 0, 0, 0]}, "rotation"),
    ({"kind": "move_instances", "ids": [1], "scale": 0}, "scale"),
    ({"kind": "move_instances", "ids": [1], "scale": float("nan")}, "scale"),
    ({"kind": "move_instances", "ids": [1], "on_ground": 1}, "on_ground"),
    ({"kind": "duplicate_instances", "ids": [1], "translation": None}, "duplicate"),
    ({"kind": "insert_scene", "path": 7}, "7"),
    ({"kind": "adjust_instances", "ids": [1], "what": "gloss", "amount": 1}, "gloss"),
    ({"kind": "adjust_instances", "ids": [1], "what": "hue", "amount": 181}, "181"),
    ({"kind": "adjust_instances", "ids": [1], "what": "opacity", "amount": 1.5}, "1.5"),
    ({"kind": "adjust_instances", "ids": [1], "what": "hue", "amount": "30"}, "30"),
    ({"kind": "compound", "edits": [{"kind": "explode"}], "name": "x"}, "explode"),
    ({"kind": "compound", "edits": 5, "name": "x"}, "compound"),
    ({"kind": "compound", "edits": [], "name": 5}, "5"),
]
REFUSE = """
import json, sys
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import EditError
for entry in json.load(sys.stdin):
    try:
        print(edit_from_json(entry))
    except EditError as error:
        print("refused:", str(error).replace(chr(10), " "))
"""


def test_entries_that_are_no_edits_are_refused_without_beartypes_help():
    entries = json.dumps([entry for entry, _ in BAD_ENTRIES])
    result = subprocess.run([sys.executable, "-c", REFUSE], input=entries, capture_output=True, text=True, check=True)
    for line, (entry, named) in zip(result.stdout.splitlines(), BAD_ENTRIES, strict=True):
        assert line.startswith("refused:"), (entry, line)
        assert named in line, (entry, line)


def test_bad_lines_are_numbered_and_nesting_is_bounded():
    good = json.dumps(SelectNone().to_json())
    assert edits_from_lines(f"\n{good}\n\n{good}\n") == [SelectNone(), SelectNone()]
    with pytest.raises(EditError, match="line 2"):
        edits_from_lines(f"{good}\n{{\n")
    nested = SelectNone().to_json()
    for _ in range(20):
        nested = {"kind": "compound", "edits": [nested], "name": "x"}
    with pytest.raises(EditError, match="nested"):
        edit_from_json(nested)
