"""Duplicates and inserted scenes: rows at the end with IDs of their own, gone without a trace after undo."""

import numpy as np
import pytest
from random_scene import assert_same_scene, random_gaussians, random_scene

from instdrive_core.edits.bases import relabel
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import fingerprint
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import EditError
from instdrive_core.instances.table import compute_middle_bounds
from instdrive_core.scene.row_buffers import RowBuffers
from instdrive_core.scene.scene import scene_from_gaussians


def untouched(document):
    """The document's scene and per-splat state are those of a fresh one."""
    fresh = Document(random_scene())
    assert_same_scene(document.scene, fresh.scene)
    for part in ("state", "colors", "transforms"):
        mine, theirs = getattr(document, part), getattr(fresh, part)
        column = "flags" if part == "state" else "indices"
        np.testing.assert_array_equal(getattr(mine, column), getattr(theirs, column))
    assert len(document.transforms) == len(document.colors) == 1
    assert document.first_free_id == fresh.first_free_id


def test_a_duplicate_is_coloured_and_moved_as_its_original():
    document = Document(random_scene())
    document.apply(RecolorInstances((2,), "solid", (1.0, 0.0, 0.0)))
    document.apply(MoveInstances((2,), (1.0, 0.0, 0.0), rotation=(0.7, 0.0, 0.0, 0.7)))
    rows = document.find_rows((2,))
    document.apply(DuplicateInstances((2,), (0.0, 5.0, 0.0)))
    copies = np.arange(200, 200 + len(rows))
    np.testing.assert_array_equal(document.find_rows((9,)), copies)
    table = document.scene.table
    assert (table[9].name, table[9].count, table[9].codeword) == ("a b\\n (9)", len(rows), table[2].codeword)
    np.testing.assert_allclose(
        document.compute_means(copies), document.compute_means(rows) + np.float32([0, 5, 0]), atol=1e-5
    )
    result = bake_document(document).gaussians
    np.testing.assert_array_equal(result.sh_dc[copies], result.sh_dc[rows])
    np.testing.assert_allclose(result.sh_rest[copies], result.sh_rest[rows], atol=1e-7)
    np.testing.assert_array_equal(result.quats[copies], result.quats[rows])
    document.apply(DeleteInstances((2,)))
    assert document.summarize_instance(9).drawn == len(rows)
    for _ in range(4):
        document.undo()
    untouched(document)


def test_a_duplicated_actor_drives_a_track_of_its_own():
    document = Document(random_scene())
    document.apply(DuplicateInstances((7, 1), (0.0, 5.0, 0.0)))
    old, new = document.scene.actors[0], document.scene.actors[2]
    assert new.id == "actor-0 copy"
    np.testing.assert_allclose(new.world_from_box[:, :3, 3], old.world_from_box[:, :3, 3] + [0, 5, 0])
    copies = document.find_rows((10,)) if document.scene.table[10].node else document.find_rows((9,))
    assert (document.scene.nodes[copies] == 3).all()
    assert not document.transforms.indices[copies].any(), "the track carries the shift"
    document.apply(DuplicateInstances((7,)))
    assert document.scene.actors[3].id == "actor-0 copy 2"
    document.apply(MoveInstances((7,), (1.0, 0.0, 0.0)))
    assert document.scene.actors[2] is new
    document.undo(), document.undo(), document.undo()
    untouched(document)
    document.redo()
    assert len(document.scene.actors) == 3


def test_another_scene_is_inserted_under_new_ids():
    document, other = Document(random_scene()), random_scene(seed=1, count=80, degree=1, features=0)
    document.open_scene = lambda path: random_scene(seed=1, count=80, degree=1, features=0)
    edit = InsertScene("parked.ply", (0.0, 0.0, 1.0))
    document.apply(edit)
    rows = np.arange(200, 280)
    scene = document.scene
    assert len(scene) == 280
    np.testing.assert_array_equal(scene.instance_ids[rows] > 0, other.instance_ids > 0)
    pairs = set(zip(other.instance_ids.tolist(), scene.instance_ids[rows].tolist(), strict=True))
    assert len(pairs) == len(np.unique(other.instance_ids)), "one new ID per old one"
    assert min(new for old, new in pairs if old) == 9
    assert scene.table[9].name == "parked – “taxi”"
    np.testing.assert_array_equal(scene.nodes[rows], np.where(other.nodes, other.nodes + 2, 0))
    assert [track.id for track in scene.actors] == ["actor-0", "actor-1", "actor-0 2", "actor-1 2"]
    np.testing.assert_array_equal(scene.gaussians.sh_rest[rows][:, :3], other.gaussians.sh_rest)
    assert not scene.gaussians.sh_rest[rows][:, 3:].any()
    still = other.nodes == 0
    np.testing.assert_allclose(
        document.compute_means(rows[still]), other.gaussians.means[still] + np.float32([0, 0, 1]), atol=1e-6
    )
    np.testing.assert_array_equal(scene.extra["confidence"][rows], other.extra["confidence"])
    document.undo()
    untouched(document)
    document.open_scene = None
    document.redo()
    assert len(scene) == 280, "redo does not need the file"
    replayed = Document(random_scene())
    replayed.open_scene = lambda path: random_scene(seed=1, count=80, degree=1, features=0)
    replayed.apply(edit_from_json(edit.to_json()))
    assert_same_scene(replayed.scene, scene)
    changed = Document(random_scene())
    changed.open_scene = lambda path: random_scene(seed=2, count=80)
    with pytest.raises(EditError, match="no longer"):
        changed.apply(edit_from_json(edit.to_json()))
    untouched(changed)


def test_a_bare_file_becomes_one_instance_that_can_be_moved():
    document = Document(random_scene())
    bare = scene_from_gaussians(random_gaussians(np.random.default_rng(0), 30, degree=3))
    with pytest.raises(EditError, match="how to open"):
        document.apply(InsertScene("some/bus.ply"))
    document.open_scene = lambda path: bare
    document.apply(InsertScene("some/bus.ply"))
    assert document.scene.table[9].name == "bus"
    document.apply(MoveInstances((9,), (2.0, 0.0, 0.0)))
    assert bare.gaussians.means.tobytes() == document.scene.gaussians.means[200:].tobytes()
    document.open_scene = lambda path: scene_from_gaussians(bare.gaussians.select(slice(0, 0)))
    with pytest.raises(EditError, match="no splats"):
        document.apply(InsertScene("empty.ply"))


@pytest.mark.parametrize("changes_between", [False, True])
def test_what_is_copied_beforehand_becomes_the_same_document(changes_between):
    """Also where that was in vain, because the document has changed since."""
    plain, prepared = Document(random_scene()), Document(random_scene())
    edit = DuplicateInstances((7, 1), (0.0, 5.0, 0.0))
    edit.prepare(prepared)
    before = [array.copy() for array in prepared.scene.gaussians.arrays().values()]
    if changes_between:
        for document in (plain, prepared):
            document.apply(DuplicateInstances((2,), (1.0, 0.0, 0.0)))
            document.apply(MoveInstances((7,), (1.0, 0.0, 0.0)))
    plain.apply(DuplicateInstances((7, 1), (0.0, 5.0, 0.0)))
    prepared.apply(edit)
    assert_same_scene(prepared.scene, plain.scene)
    assert fingerprint(prepared) == fingerprint(plain)
    while prepared.history.cursor:
        prepared.undo()
    untouched(prepared)
    for array, kept in zip(prepared.scene.gaussians.arrays().values(), before, strict=True):
        np.testing.assert_array_equal(array, kept)
    while prepared.redo():
        pass
    assert fingerprint(prepared) == fingerprint(plain)


def test_what_was_copied_beforehand_is_only_put_in_place(monkeypatch):
    document = Document(random_scene())
    edit = DuplicateInstances((2,))
    edit.prepare(document)
    monkeypatch.setattr(DuplicateInstances, "build_addition", None)
    monkeypatch.setattr(document, "grow_gaussians", None)
    monkeypatch.setattr(relabel, "recount_instances", None)
    document.apply(edit)
    monkeypatch.undo()
    copied, copies = document.scene.table[9], document.find_rows((9,))
    assert copied.count == document.scene.table[2].count == len(copies)
    assert copied.bounds == compute_middle_bounds(document.compute_means(copies))
    np.testing.assert_array_equal(copies, np.flatnonzero(document.scene.instance_ids == 9))


def test_redo_takes_what_undo_has_kept_unless_something_was_written_there(monkeypatch):
    document = Document(random_scene())
    document.apply(RecolorInstances((2,), "solid", (1.0, 0.0, 0.0)))
    document.apply(DuplicateInstances((2, 7), (0.0, 1.0, 0.0)))
    document.apply(MoveInstances((9,), (1.0, 0.0, 0.0)))
    wanted = fingerprint(document)
    for _ in range(2):
        document.undo()
    with monkeypatch.context() as patch:
        patch.setattr(DuplicateInstances, "build_addition", None)
        document.redo()
    document.redo()
    assert fingerprint(document) == wanted
    for _ in range(2):
        document.undo()
    DuplicateInstances((1, 2), (0.0, 0.0, 1.0)).prepare(document)  # and is given up
    for _ in range(2):
        document.redo()
    assert fingerprint(document) == wanted


def test_buffers_grow_in_place_and_never_write_into_foreign_memory():
    buffers, foreign = RowBuffers(), np.arange(20.0)
    view = foreign[:8]
    first = buffers.extend("x", view, np.array([1.0]))
    np.testing.assert_array_equal(foreign, np.arange(20.0))
    second = buffers.extend("x", first, np.array([2.0]))
    assert np.shares_memory(first, second)
    np.testing.assert_array_equal(second, [*range(8), 1, 2])
    third = buffers.extend("x", second, np.arange(50.0))
    assert not np.shares_memory(second, third)
    np.testing.assert_array_equal(third[8:12], [1, 2, 0, 1])
    other = buffers.extend("x", third[:3].copy(), np.array([7.0]))
    np.testing.assert_array_equal(other, [0, 1, 2, 7])


def test_dirty_rows_never_reach_beyond_the_last_row():
    document = Document(random_scene())
    readers = [part.create_dirty_reader() for part in (document.state, document.colors, document.transforms)]
    for reader in readers:
        reader.take()
    document.apply(DuplicateInstances((2,)))
    count = len(document.scene)
    assert [reader.take() for reader in readers] == [(200, count)] * 3
    document.apply(DuplicateInstances((2,)))
    document.undo(), document.undo()
    assert [reader.take() for reader in readers] == [None] * 3
