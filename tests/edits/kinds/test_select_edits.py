"""Selecting rows, classes, everything and the inverse; growing and shrinking."""

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.row_runs import RowRuns
from instdrive_core.edits.kinds.classes import SetInstanceClass
from instdrive_core.edits.kinds.grow import GrowSelection, ShrinkSelection
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select import InvertSelection, SelectAll, SelectClass, SelectInstances, SelectNone
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.kinds.visibility import HideInstances, LockInstances
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.edits.serialize import edits_from_lines, edits_to_lines
from instdrive_core.errors import EditError
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import scene_from_gaussians
from instdrive_core.scene.selection import Flag


@pytest.fixture
def document():
    return Document(random_scene())


def selected(document):
    return document.state.find_rows(Flag.SELECTED).tolist()


def rows_of(document, *ids):
    return np.flatnonzero(np.isin(document.scene.instance_ids, ids)).tolist()


def grid_document(count=20, spacing=0.1):
    """A flat sheet of `count` × `count` splats."""
    x, y = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    means = np.stack([x.ravel(), y.ravel(), np.zeros(count * count)], axis=1) * spacing
    zeros = np.zeros((count * count, 4), np.float32)
    gaussians = Gaussians(
        means.astype(np.float32),
        zeros + np.float32([1, 0, 0, 0]),
        zeros[:, :3] - 3,
        zeros[:, 0],
        zeros[:, :3],
        np.zeros((count * count, 0, 3), np.float32),
        zeros[:, :0],
    )
    return Document(scene_from_gaussians(gaussians))


# Rows


@pytest.mark.parametrize("rows", [[], [0], [3, 4, 5], [0, 2, 3, 9, 10, 11]])
def test_runs_give_their_rows_back(rows):
    runs = RowRuns.from_rows(np.array(rows, np.int64))
    assert runs.rows.tolist() == rows
    assert len(runs) == len(rows)
    assert RowRuns.from_json(runs.to_json()) == runs
    assert runs.end == (rows[-1] + 1 if rows else 0)


def test_runs_of_rows_in_any_order_are_the_same():
    assert RowRuns.from_rows(np.array([5, 1, 2, 5], np.int32)).to_json() == [[1, 2], [5, 1]]


@pytest.mark.parametrize(
    "pairs",
    [[[0]], [[0, 0]], [[-1, 2]], [[0, 2], [2, 1]], [[5, 1], [1, 1]], [[0, True]], [[0, 1.0]], ["ab"], [[0, 1 << 70]]],
)
def test_what_is_no_run_is_refused(pairs):
    with pytest.raises(EditError, match="rows"):
        SelectRows(pairs)


def test_rows_replace_add_remove_and_intersect(document):
    document.apply(SelectRows(np.array([1, 2, 3, 7])))
    assert selected(document) == [1, 2, 3, 7]
    document.apply(SelectRows(np.array([10, 11]), "add"))
    document.apply(SelectRows(np.array([2, 5]), "remove"))
    assert selected(document) == [1, 3, 7, 10, 11]
    document.apply(SelectRows(np.array([3, 4, 10]), "intersect"))
    assert selected(document) == [3, 10]
    document.apply(SelectRows(np.array([], np.int64)))
    assert selected(document) == []


def test_intersecting_spares_only_what_both_hold(document):
    document.apply(SelectInstances((1, 2)))
    document.apply(SelectInstances((2, 3), "intersect"))
    assert document.find_selected_instances() == (2,)
    document.undo()
    assert document.find_selected_instances() == (1, 2)


def test_rows_beyond_the_scene_are_refused_before_anything_changes(document):
    with pytest.raises(EditError, match="row 200 is beyond"):
        document.apply(SelectRows(np.array([0, 200])))
    with pytest.raises(EditError, match="beyond"):
        document.apply(SelectRows([[0, 1 << 60]]))
    assert selected(document) == []


def test_hidden_and_locked_rows_are_passed_over(document):
    document.apply(HideInstances((1,)))
    document.apply(LockInstances((2,)))
    document.apply(SelectRows(np.arange(200)))
    assert selected(document) == sorted(set(range(200)) - set(rows_of(document, 1, 2)))


def test_rows_are_logged_as_runs_and_replayed(document):
    document.apply(SelectRows(np.arange(20, 150)))
    document.apply(InvertSelection())
    lines = edits_to_lines(document.history.done)
    assert "[[20, 130]]" in lines
    replayed = Document(random_scene())
    for edit in edits_from_lines(lines):
        replayed.apply(edit)
    assert selected(replayed) == selected(document)
    assert replayed.history.done == document.history.done


# All, inverse, class


def test_all_and_inverse_leave_out_what_cannot_be_selected(document):
    document.apply(HideInstances((1,)))
    document.apply(LockInstances((2,)))
    free = sorted(set(range(200)) - set(rows_of(document, 1, 2)))
    document.apply(SelectInstances((3,)))
    document.apply(InvertSelection())
    assert selected(document) == sorted(set(free) - set(rows_of(document, 3)))
    document.apply(InvertSelection())
    assert selected(document) == rows_of(document, 3)
    document.apply(SelectAll())
    assert selected(document) == free
    document.apply(SelectNone())
    assert selected(document) == []


def test_a_class_is_all_its_instances(document):
    document.apply(SetInstanceClass(4, "Car"))
    document.apply(SelectClass("Car"))
    assert document.find_selected_instances() == (1, 4)
    document.apply(SelectClass(""))
    assert not {1, 4} & set(document.find_selected_instances())
    with pytest.raises(EditError, match=r"'Bus'.*classes are: Car"):
        document.apply(SelectClass("Bus"))


# Growing and shrinking


def test_growing_adds_a_ring_and_shrinking_takes_it_off():
    document = grid_document()
    square = np.array([x * 20 + y for x in range(8, 12) for y in range(8, 12)])
    document.apply(SelectRows(square))
    document.apply(GrowSelection(0.15))
    assert selected(document) == [x * 20 + y for x in range(7, 13) for y in range(7, 13)]
    document.apply(ShrinkSelection(0.15))
    assert selected(document) == square.tolist()
    document.undo()
    document.undo()
    assert selected(document) == square.tolist()


def test_without_a_distance_it_is_the_splats_own_spacing():
    for spacing in (0.1, 2.0):
        document = grid_document(spacing=spacing)
        document.apply(SelectRows(np.array([x * 20 + y for x in range(4, 16) for y in range(4, 16)])))
        document.apply(GrowSelection())
        # About one ring: at least the four sides, at most two rings.
        assert 144 + 48 <= len(selected(document)) <= 256
        document.apply(ShrinkSelection())
        assert 64 <= len(selected(document)) <= 144


def test_locked_hidden_and_deleted_splats_are_not_grown_into():
    document = grid_document()
    document.apply(SelectRows(np.array([210])))
    document.state.change(np.array([209]), Flag.HIDDEN, True)
    document.state.change(np.array([211]), Flag.LOCKED, True)
    document.state.change(np.array([190]), Flag.DELETED, True)
    document.apply(GrowSelection(0.11))
    assert selected(document) == [210, 230]
    # The locked neighbour is seen: the selection ends there. Hidden and deleted ones are not.
    document.apply(SelectRows(np.array([210])))
    document.state.change(np.array([230]), Flag.HIDDEN, True)
    document.apply(ShrinkSelection(0.11))
    assert selected(document) == []
    document.undo()
    document.state.change(np.array([211]), Flag.HIDDEN, True)
    document.apply(ShrinkSelection(0.11))
    assert selected(document) == [210]


def test_neighbours_are_those_of_the_moment_and_of_the_moved_place():
    scene = random_scene()
    document = Document(scene)
    document.apply(MoveInstances((1,), (50.0, 0.0, 0.0)))
    document.apply(SelectInstances((1,)))
    means, drawn = compute_shown_means(document, 0.2)
    inside = np.isin(scene.instance_ids, [1])
    apart = np.linalg.norm(means[:, None] - means[None, inside], axis=2).min(axis=1)
    assert apart[~inside].min() > 20
    document.apply(GrowSelection(10.0, 0.2))
    assert selected(document) == np.flatnonzero(inside).tolist()
    document.apply(SelectInstances((7,)))
    means, drawn = compute_shown_means(document, 0.2)
    inside = scene.instance_ids == 7
    apart = np.linalg.norm(means[:, None] - means[None, inside], axis=2).min(axis=1)
    document.apply(GrowSelection(0.8, 0.2))
    expected = np.flatnonzero(drawn & (inside | (apart <= 0.8)))
    assert inside.sum() < len(expected) < 200
    assert selected(document) == expected.tolist()


def test_growing_nothing_is_refused(document):
    for edit in (GrowSelection(), ShrinkSelection()):
        with pytest.raises(EditError, match="nothing is selected"):
            document.apply(edit)


@pytest.mark.parametrize("distance", [0.0, -1.0, float("nan"), float("inf")])
def test_distances_that_are_none_are_refused(distance):
    with pytest.raises(EditError, match="metres above 0"):
        GrowSelection(distance)
