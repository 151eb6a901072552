"""Scenes without instances: selected splats become *Selection n* at the first use of an action."""

import numpy as np
import pytest
from procedural_street import procedural_street

from instdrive_app.session.requests import AskName
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.scene.scene import scene_from_gaussians

ROWS = np.arange(100, 400)


@pytest.fixture
def bare(session):
    """A session on the street as another program would have it, with some splats selected."""
    scene = procedural_street()
    session.show(Document(scene_from_gaussians(scene.gaussians.select(scene.nodes == 0))))
    assert session.state.region_splats, "regions select splats, as there are no instances"
    session.history.apply(SelectRows(ROWS))
    return session


@pytest.mark.parametrize(
    "action", ["edit.recolor", "edit.hide", "edit.lock", "edit.solo", "edit.rename", "move.duplicate", "labels.class"]
)
def test_the_first_action_makes_an_instance_of_the_selection(bare, action):
    table = bare.document.scene.table
    assert not len(table)
    assert bare.actions.run(action)
    first = min(instance.id for instance in table)
    assert table[first].name == "Selection 1"
    assert table[first].count == len(ROWS)
    assert bare.document.history.done[1].title == "Selection 1"
    while bare.document.history.cursor:
        bare.history.undo()
    assert not len(table)


@pytest.mark.parametrize("tool", ["move", "rotate", "scale"])
def test_tools_with_handles_get_something_to_hold(bare, tool):
    bare.actions.run(f"tool.{tool}")
    assert len(bare.movement.ids) == 1
    assert bare.movement.find_box().size.max() > 0


def test_the_next_selection_has_the_next_number_and_instances_are_left_alone(bare):
    bare.actions.run("edit.rename")
    assert isinstance(bare.requests.take(AskName), AskName)
    steps = bare.document.history.cursor
    bare.actions.run("edit.lock")
    assert bare.document.history.cursor == steps + 1, "it is an instance already"
    bare.history.undo()
    bare.history.apply(SelectRows(ROWS + 1000))
    bare.actions.run("edit.hide")
    assert [instance.name for instance in bare.document.scene.table] == ["Selection 1", "Selection 2"]


def test_nothing_selected_changes_nothing(session):
    session.selection.clear()
    assert not session.selection.name_loose_splats()
    assert not session.actions.run("edit.hide")
