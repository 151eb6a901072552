"""Random sequences of edits: undone, redone and replayed they give every bit again."""

from document_snapshot import snapshot
from edit_cases import EXAMPLES, rich_document
from hypothesis import given, settings
from hypothesis import strategies as st

from instdrive_core.edits.document.invariants import find_broken_invariants
from instdrive_core.edits.registry import EDIT_KINDS
from instdrive_core.edits.serialize import edit_from_json, edits_from_lines, edits_to_lines
from instdrive_core.errors import EditError
from instdrive_core.scene.selection import Flag


def entries(kind, **parameters):
    """Edits as JSON: making them while hypothesis draws would let beartype's random checks disturb it."""
    return st.fixed_dictionaries({"kind": st.just(kind), **parameters})


ids = st.lists(st.integers(1, 9), min_size=1, max_size=3)
modes = st.sampled_from(["replace", "add", "remove", "intersect"])
channels = st.sampled_from([0.0, 0.25, 1.0])
adjustments = st.sampled_from(
    [
        ("hue", 40.0),
        ("contrast", 1.5),
        ("temperature", -0.5),
        ("opacity", 0.5),
        ("saturation", 1.0),
        ("brightness", 2.0),
    ]
)


def adjust(kind):
    return adjustments.flatmap(lambda pair: entries(kind, ids=ids, what=st.just(pair[0]), amount=st.just(pair[1])))


half = 0.5**0.5
ways = st.sampled_from(
    [[[0.2, 1.0, 1.0]], [[0.0, 0.0, 0.0], [0.3, 2.0, 0.5]], [[0.1, 1.0, 0.0, 0.5], [0.9, 0.0, 1.0, 2.0]]]
)
simple_edits = (
    entries("select_instances", ids=ids, mode=modes),
    entries("select_codeword", codeword=st.integers(9, 13), mode=modes),
    entries("select_none"),
    entries("select_all"),
    entries("invert_selection"),
    entries("select_class", class_name=st.sampled_from(["", "Car"]), mode=modes),
    entries("select_rows", rows=st.sampled_from([[], [[3, 9]], [[0, 1], [1600, 400]], [[5000, 30]]]), mode=modes),
    entries("grow_selection", distance=st.sampled_from([None, 0.5, 2.0]), time=st.sampled_from([0.0, 0.3])),
    entries("shrink_selection", distance=st.sampled_from([None, 0.5, 2.0])),
    entries("delete_instances", ids=ids),
    entries("delete_rows", rows=st.sampled_from([[], [[3, 9]], [[0, 1], [1600, 400]]])),
    entries("delete_selected"),
    entries("hide_instances", ids=ids, hidden=st.booleans()),
    entries("hide_rows", rows=st.sampled_from([[], [[3, 9]], [[0, 1], [1600, 400]]]), hidden=st.booleans()),
    entries("solo_instances", ids=ids),
    entries("lock_instances", ids=ids, locked=st.booleans()),
    entries("show_all"),
    entries(
        "recolor_instances",
        ids=ids,
        mode=st.sampled_from(["tint", "solid", "hue"]),
        color=st.lists(channels, min_size=3, max_size=3),
    ),
    entries(
        "paint_instances",
        ids=ids,
        color=st.lists(channels, min_size=3, max_size=3),
        tolerance=st.sampled_from([0.0, 0.18, 1.0]),
        reference=st.none() | st.lists(channels, min_size=3, max_size=3),
    ),
    entries("reset_colors", ids=ids),
    adjust("adjust_instances"),
    adjust("set_adjustment"),
    entries("rename_instance", id=st.integers(1, 9), name=st.sampled_from(["car", "bus"])),
    entries("set_class", ids=ids, class_name=st.sampled_from(["", "Car"])),
    entries("set_instance_class", id=st.integers(1, 9), class_name=st.sampled_from(["", "Car"])),
    entries("merge_instances", ids=ids, into=st.integers(1, 9)),
    entries("split_instance", id=st.integers(1, 9), gap=st.sampled_from([0.25, 1.5])),
    entries("reassign_selected", into=st.sampled_from([None, 0, 1, 7])),
    entries("find_objects", gap=st.sampled_from([0.3, 0.5]), unit=st.sampled_from([None, 1.0])),
    entries("absorb_floaters", id=st.integers(1, 9)),
    entries(
        "relabel_rows",
        found_by=st.sampled_from(["split_instance", "find_objects"]),
        parts=st.sampled_from([[[]], [[[3, 9]]], [[[0, 1], [1600, 400]]]]),
        into=st.sampled_from([[None], [1], [7]]),
        like=st.integers(0, 9),
        deletes=st.booleans(),
    ),
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
    entries("reset_moves", ids=ids),
    entries(
        "turn_scene",
        rotation=st.sampled_from([[1.0, 0.0, 0.0, 0.0], [half, half, 0.0, 0.0], [0.9, 0.1, 0.2, 0.3]]),
        scale=st.sampled_from([1.0, 0.5]),
    ),
    entries("duplicate_instances", ids=ids, translation=st.sampled_from([[0.0, 0.0, 0.0], [1.0, 2.0, 0.0]])),
    entries("insert_scene", path=st.just("other.ply")),
    entries("set_path", id=st.integers(1, 9), keys=ways),
    entries("start_driving", id=st.integers(1, 9), keys=ways),
    entries(
        "complete_instance",
        id=st.integers(1, 9),
        place=st.sampled_from([[0.0, 0.0], [0.0, 2.0]]),
        heading=st.sampled_from([0.0, 1.5]),
        side=st.sampled_from([1, -1]),
    ),
    entries("lay_shadow", id=st.integers(1, 9), contact=st.sampled_from([0.0, 0.6]), time=st.sampled_from([0.0, 0.3])),
    st.sampled_from([0, 1]).map(lambda seed: {"kind": "fill_hole", **EXAMPLES["fill_hole"], "seed": seed}),
)
edits = st.one_of(
    *simple_edits, entries("compound", edits=st.lists(st.one_of(*simple_edits), max_size=3), name=st.just("several"))
)


@settings(max_examples=1)
@given(st.tuples(*simple_edits))
def test_every_kind_is_drawn(drawn):
    assert {entry["kind"] for entry in drawn} | {"compound"} == EDIT_KINDS.keys()


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(edits, st.sampled_from([None, None, "drag"])), max_size=12))
def test_undone_and_redone_edits_restore_every_bit(steps):
    document = rich_document()
    snapshots, begun = [snapshot(document)], document.history.cursor
    for entry, gesture in steps:
        edit = edit_from_json(entry)
        before, cursor = snapshot(document), document.history.cursor
        try:
            document.apply(edit, gesture)
        except EditError:
            assert (snapshot(document), document.history.cursor) == (before, cursor)
        del snapshots[document.history.cursor - begun :]
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
        summary = document.summarize_instance(instance.id)
        assert summary.count == instance.count == len(members)
        assert summary.selected == (members & Flag.SELECTED != 0).sum()
        assert summary.drawn == (members & (Flag.HIDDEN | Flag.DELETED) == 0).sum()
    assert find_broken_invariants(document) == []


@settings(deadline=None, max_examples=40)
@given(st.lists(edits, max_size=8))
def test_serialised_edits_replay_to_the_same_state(steps):
    document = rich_document()
    begun = document.history.cursor
    for entry in steps:
        try:
            document.apply(edit_from_json(entry))
        except EditError:
            continue
    lines = edits_to_lines(document.history.done[begun:])
    replayed = rich_document()
    for edit in edits_from_lines(lines):
        replayed.apply(edit)
    assert snapshot(replayed) == snapshot(document)
    assert replayed.history.done[begun:] == document.history.done[begun:]
