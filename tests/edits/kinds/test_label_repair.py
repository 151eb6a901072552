"""Split, reassign, absorb: which splats change hands, and that undo gives them back."""

import numpy as np
import pytest
from random_scene import random_gaussians, random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds import split
from instdrive_core.edits.kinds.absorb import AbsorbFloaters
from instdrive_core.edits.kinds.classes import SetClass, SetInstanceClass
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.edits.kinds.visibility import LockInstances
from instdrive_core.edits.serialize import edits_from_lines, edits_to_lines
from instdrive_core.errors import EditError
from instdrive_core.instances.components import split_components
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag


def scene_of(means, ids, colors=None, nodes=None):
    """Small solid splats at given places."""
    gaussians = random_gaussians(np.random.default_rng(0), len(means), degree=0, features=0)
    gaussians.means[:] = means
    gaussians.log_scales[:] = np.log(0.02)
    gaussians.opacity_logits[:] = 3
    if colors is not None:
        gaussians.sh_dc[:] = dc_from_color(np.asarray(colors))
    ids = np.asarray(ids, np.uint32)
    zeros = np.zeros(len(ids), np.uint32)
    nodes = np.zeros(len(ids), np.uint16) if nodes is None else nodes
    table = build_instance_table(ids, gaussians.means, zeros, nodes, {1: "car"}, {1: "Car"})
    return Scene(gaussians, ids, zeros, nodes, table)


def box_shell(rng, count, center, size):
    """Points on the faces of a box."""
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis]) / 2
    return points * size + center


def state_of(document):
    scene = document.scene
    return scene.instance_ids.tobytes(), list(scene.table), document.state.flags.tobytes(), document.first_free_id


def three_clumps(gaps=(1.0, 1.0)):
    """60, 40 and 20 splats of one instance in a row, and another instance far away."""
    rng = np.random.default_rng(1)
    centers = np.repeat([[0, 0, 0], [gaps[0] + 0.5, 0, 0], [sum(gaps) + 1, 0, 0], [50, 0, 0]], [60, 40, 20, 30], axis=0)
    return scene_of(centers + rng.uniform(-0.25, 0.25, (150, 3)), np.repeat([1, 2], [120, 30]))


def test_parts_become_instances_and_the_largest_keeps_the_id():
    document = Document(three_clumps())
    before = state_of(document)
    document.apply(SplitInstance(1))
    after = document.scene.instance_ids
    assert [set(after[part].tolist()) for part in (slice(60), slice(60, 100), slice(100, 120))] == [{1}, {3}, {4}]
    table = document.scene.table
    assert [table[number].count for number in (1, 3, 4)] == [60, 40, 20]
    assert (table[1].name, table[3].name, table[3].class_name) == ("car", "car (3)", "Car")
    assert table[1].bounds[1][0] < 0.3
    document.undo()
    assert state_of(document) == before
    document.redo()
    assert document.scene.table[4].count == 20


def test_the_gap_decides_for_sparse_parts():
    grid = 0.2 * np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0), [0.0]), axis=-1).reshape(-1, 3)
    document = Document(scene_of(np.concatenate([grid, grid + np.array([1.5, 0, 0])]), np.ones(72, int)))
    with pytest.raises(EditError, match="hangs together"):
        document.apply(SplitInstance(1, gap=1.0))
    document.apply(SplitInstance(1, gap=0.3))
    assert [instance.count for instance in document.scene.table] == [36, 36]
    for gap in (0.0, float("nan"), float("inf"), -1.0):
        with pytest.raises(EditError, match="gap"):
            SplitInstance(1, gap)


def test_parts_found_on_a_copy_are_used_only_while_they_hold(monkeypatch):
    looked, document = [], Document(three_clumps())

    def components(*arrays):
        looked.append(len(arrays[0]))
        return split_components(*arrays)

    monkeypatch.setattr(split, "split_components", components)
    edit = SplitInstance(1)
    assert edit.prepare(freeze_document(document)) == (60, 40, 20)
    document.apply(edit)
    document.undo()
    document.redo()
    assert looked == [120], "neither doing nor redoing looks again"
    assert document.scene.table[4].count == 20
    document.undo()
    document.apply(MoveInstances((1,), (5.0, 0.0, 0.0)))
    document.apply(edit)
    assert looked == [120, 120], "what was moved is looked at again"
    assert edits_from_lines(edits_to_lines([edit])) == [edit]


def test_ids_are_never_used_again():
    document = Document(three_clumps())
    document.apply(SplitInstance(1))
    document.apply(MergeInstances((3, 4), 1))
    document.apply(SplitInstance(1))
    assert {instance.id for instance in document.scene.table} == {1, 2, 5, 6}


def test_selected_splats_go_to_an_instance_a_new_one_or_none():
    document = Document(random_scene())
    rows = np.flatnonzero(document.scene.instance_ids == 2)
    document.apply(SelectInstances((2,)))
    before = state_of(document)
    document.apply(ReassignSelected(3))
    assert set(document.scene.instance_ids[rows].tolist()) == {3}
    assert 2 not in document.scene.table, "emptied instances leave the table"
    document.undo()
    assert state_of(document) == before
    document.apply(ReassignSelected())
    assert set(document.scene.instance_ids[rows].tolist()) == {9}
    assert document.scene.table[9].count == len(rows)
    document.apply(ReassignSelected(0))
    assert not document.scene.instance_ids[rows].any()
    assert 9 not in document.scene.table
    document.apply(ReassignSelected())
    assert set(document.scene.instance_ids[rows].tolist()) == {10}
    document.apply(RenameInstance(10, "found"))


def test_splats_of_another_track_are_refused():
    document = Document(random_scene())
    with pytest.raises(EditError, match="nothing is selected"):
        document.apply(ReassignSelected(3))
    document.apply(SelectInstances((2, 7)))
    for into in (3, None):
        with pytest.raises(EditError, match="another object"):
            document.apply(ReassignSelected(into))
    with pytest.raises(EditError, match="no instance 77"):
        document.apply(ReassignSelected(77))


CAR, ROAD, WALL, PERSON = 1, 2, 3, 4


def street():
    """A red car on a road with a grey wall: what is inside of the car carries wrong labels; a person stands by.

    Returns the scene and the rows by what they are.
    """
    rng = np.random.default_rng(2)
    rows = {
        "car": box_shell(rng, 900, [0, 0, 0.8], [1.9, 4.5, 1.5]),
        "inside": rng.uniform([-0.7, -1.8, 0.4], [0.7, 1.8, 1.3], (60, 3)),
        "red_close": box_shell(rng, 30, [0, 0, 0.9], [2.1, 4.7, 1.5]),
        "grey_close": box_shell(rng, 30, [0, 0, 0.9], [2.1, 4.7, 1.5]),
        "road": np.c_[rng.uniform(-10, 10, (900, 2)), np.zeros(900)],
        "wall": np.c_[rng.uniform(3, 3.1, 600), rng.uniform(-10, 10, 600), rng.uniform(0, 4, 600)],
        "person": box_shell(rng, 200, [1.6, 0, 0.9], [0.5, 0.5, 1.7]),
    }
    rows["red_close"][:, 2] = np.maximum(rows["red_close"][:, 2], 0.4)
    labels = {"car": CAR, "inside": ROAD, "red_close": 0, "grey_close": 0, "road": ROAD, "wall": WALL, "person": PERSON}
    red, grey = [0.8, 0.1, 0.1], [0.5, 0.5, 0.5]
    colors = {name: red if name in ("car", "red_close") else grey for name in rows}
    numbers = np.cumsum([0, *(len(part) for part in rows.values())])
    where = {name: np.arange(numbers[k], numbers[k + 1]) for k, name in enumerate(rows)}
    scene = scene_of(
        np.concatenate(list(rows.values())),
        np.concatenate([np.full(len(part), labels[name]) for name, part in rows.items()]),
        np.concatenate([np.tile(colors[name], (len(part), 1)) for name, part in rows.items()]),
    )
    return scene, where


def test_floaters_inside_and_alike_ones_close_around_join_the_car():
    scene, where = street()
    document = Document(scene)
    before = state_of(document)
    document.apply(AbsorbFloaters(CAR))
    ids = document.scene.instance_ids
    assert (ids[where["inside"]] == CAR).all()
    assert (ids[where["red_close"]] == CAR).mean() > 0.9
    assert (ids[where["grey_close"]] == 0).mean() > 0.9, "another colour outside of the hull is no part of the car"
    for name, label in (("road", ROAD), ("wall", WALL), ("person", PERSON), ("car", CAR)):
        assert (ids[where[name]] == label).all(), name
    assert document.scene.table[CAR].count == (ids == CAR).sum()
    document.undo()
    assert state_of(document) == before


def test_floaters_of_a_deleted_car_are_deleted_with_it():
    scene, where = street()
    document = Document(scene)
    document.apply(DeleteInstances((CAR,)))
    before = state_of(document)
    document.apply(SelectInstances((ROAD,)))
    selected = state_of(document)
    document.apply(AbsorbFloaters(CAR))
    assert (document.state.flags[where["inside"]] == Flag.DELETED).all()
    assert document.summarize_instance(CAR).is_deleted
    document.undo()
    assert state_of(document) == selected
    document.undo()
    assert state_of(document) == before
    document.redo()
    document.redo()
    assert (document.state.flags[where["inside"]] == Flag.DELETED).all()


def test_locked_splats_are_not_absorbed_and_surfaces_have_no_inside():
    scene, where = street()
    document = Document(scene)
    document.apply(LockInstances((ROAD,)))
    document.apply(AbsorbFloaters(CAR))
    assert (document.scene.instance_ids[where["inside"]] == ROAD).all()
    document.apply(LockInstances((ROAD,), locked=False))
    for surface in (ROAD, WALL):
        with pytest.raises(EditError, match="no compact body"):
            document.apply(AbsorbFloaters(surface))


@pytest.mark.parametrize(
    "edit",
    [
        MergeInstances((1,), 2),
        MergeInstances((2,), 1),
        RenameInstance(1, "taxi"),
        SetInstanceClass(1, "Truck"),
        SetClass((1, 2), "Truck"),
        ReassignSelected(1),
        AbsorbFloaters(1),
        SplitInstance(1, 0.5),
    ],
    ids=lambda edit: edit.title,
)
def test_what_is_locked_keeps_its_splats_name_and_class(edit):
    document = Document(three_clumps())
    document.apply(SelectInstances((2,)))
    document.apply(LockInstances((1,)))
    before = state_of(document)
    with pytest.raises(EditError, match="unlock it first"):
        document.apply(edit)
    assert state_of(document) == before
    document.apply(LockInstances((1,), locked=False))
    if not isinstance(edit, AbsorbFloaters):  # clumps have no inside
        document.apply(edit)
        assert state_of(document) != before
