"""Region tools, their commands and their outline, without a window."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import FIRST_CAR, ROAD, procedural_street

from instdrive_app.actions import register_actions
from instdrive_app.panels.overlays.region_outline import DASH, compute_dashes
from instdrive_app.pointer import Click
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import resolve
from instdrive_app.tools.registry import TOOLS, create_tools
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.scene.selection import Flag

SIZE = (480, 270)


@pytest.fixture
def session():
    session = EditorSession()
    register_actions(session)
    session.show(Document(procedural_street()))
    yield session
    session.close()


@pytest.fixture
def snapshot(session):
    return resolve(session.state, *SIZE, draft=True)


@pytest.fixture
def tools(session, snapshot):
    """The tools, with every splat standing for the pixel that its centre is in, nearest last written."""
    document = session.document
    means, drawn = compute_shown_means(document, snapshot.time)
    pixels, depth = snapshot.camera.project(means)
    columns, rows = np.floor(pixels).astype(int).T
    seen = drawn & (depth > 0.1) & (columns >= 0) & (columns < SIZE[0]) & (rows >= 0) & (rows < SIZE[1])
    order = np.flatnonzero(seen)[np.argsort(-depth[seen])]
    winners = np.zeros(SIZE[::-1], np.uint32)
    winners[rows[order], columns[order]] = order + 1

    def winners_of(asked):
        assert not asked.draft, "a draft has fewer pixels"
        return winners

    return create_tools(session, winners_of)


def find_selected_rows(session):
    return session.document.state.find_rows(Flag.SELECTED)


def car_box(session, snapshot, car=FIRST_CAR + 1):
    means, _ = compute_shown_means(session.document, snapshot.time)
    pixels, _ = snapshot.camera.project(means[session.document.scene.instance_ids == car])
    return tuple(pixels.min(axis=0) - 1), tuple(pixels.max(axis=0) + 1)


def drag_over(tool, session, snapshot, **keys):
    low, high = car_box(session, snapshot)
    tool.drag(low, high)
    tool.release(Click(*high, **keys), snapshot)


def test_a_rectangle_takes_whole_instances(session, tools, snapshot):
    tool = tools["rectangle"]
    low, high = car_box(session, snapshot)
    tool.drag(low, (low[0] + 5, high[1]))
    tool.drag(low, high)
    assert len(tool.outline) == 4
    tool.release(Click(*high), snapshot)
    assert tool.outline == ()
    assert FIRST_CAR + 1 in session.selection.ids
    assert ROAD not in session.selection.ids
    ids = session.document.scene.instance_ids
    assert set(find_selected_rows(session)) == set(np.flatnonzero(np.isin(ids, session.selection.ids)))


def test_keys_add_remove_and_intersect(session, tools, snapshot):
    tool = tools["rectangle"]
    drag_over(tool, session, snapshot)
    inside = set(session.selection.ids)
    session.selection.select((ROAD,))
    drag_over(tool, session, snapshot, shift=True)
    assert set(session.selection.ids) == inside | {ROAD}
    drag_over(tool, session, snapshot, ctrl=True)
    assert session.selection.ids == (ROAD,)
    session.actions.run("select.all")
    drag_over(tool, session, snapshot, shift=True, ctrl=True)
    assert set(session.selection.ids) == inside


def test_an_empty_region_clears_or_keeps_as_its_mode_says(session, tools, snapshot):
    tool = tools["rectangle"]
    for keys, left in (({"shift": True}, 1), ({"ctrl": True}, 1), ({"shift": True, "ctrl": True}, 0), ({}, 0)):
        for splats in (False, True):
            session.state.region_splats = splats
            session.selection.select((FIRST_CAR,))
            tool.drag((1.0, 1.0), (1.2, 1.2))
            tool.release(Click(1.2, 1.2, **keys), snapshot)
            assert len(session.selection.ids) == left, (keys, splats)


def test_splats_through_everything_or_visible_ones_only(session, tools, snapshot):
    session.actions.run("tool.single_splats")
    tool = tools["rectangle"]
    drag_over(tool, session, snapshot)
    visible = set(find_selected_rows(session))
    session.actions.run("tool.visible_only")
    drag_over(tool, session, snapshot)
    everything = set(find_selected_rows(session))
    assert visible < everything
    low, high = car_box(session, snapshot)
    means, _ = compute_shown_means(session.document, snapshot.time)
    pixels, _ = snapshot.camera.project(means[list(everything)])
    assert (pixels >= np.floor(low) - 1).all()
    assert (pixels <= np.ceil(high) + 1).all()
    session.actions.run("tool.whole_instances")
    assert not session.state.region_splats


def test_a_lasso_follows_the_pointer_and_skips_jitter(session, tools, snapshot):
    tool = tools["lasso"]
    (left, top), (right, bottom) = car_box(session, snapshot)
    for x, y in ((left, bottom), (left + 0.5, bottom), (right, bottom), (right, top), (left, top)):
        tool.drag((left, bottom), (x, y))
    assert len(tool.outline) == 4
    tool.release(Click(left, top), snapshot)
    assert FIRST_CAR + 1 in session.selection.ids
    tool.drag((0, 0), (50, 50))
    tool.cancel()
    assert tool.outline == ()
    before = session.document.history.cursor
    tool.release(Click(50, 50), snapshot)
    assert session.document.history.cursor == before, "a cancelled drag selects nothing"


def test_every_tool_has_a_command_and_takes_itself_in_hand(session, tools):
    assert set(tools) == {record.name for record in TOOLS}
    for record in TOOLS:
        assert session.actions.run(f"tool.{record.name}")
        assert session.state.tool == record.name
        assert session.actions[f"tool.{record.name}"].checked()
        assert all(session.actions[option].icon for option in tools[record.name].options)


def test_delete_takes_the_selected_splats_only(session):
    car = np.flatnonzero(session.document.scene.instance_ids == FIRST_CAR)
    session.selection.select((FIRST_CAR,))
    session.actions.run("edit.delete")
    assert session.document.history.edits[-1].title == f"Delete instance {FIRST_CAR}"
    session.history.undo()
    session.actions.run("select.shrink")
    kept = set(car) - set(find_selected_rows(session))
    assert 0 < len(kept) < len(car)
    session.actions.run("edit.delete")
    assert set(car[session.document.state.flags[car] == 0]) == kept
    session.history.undo()
    assert not session.document.state.find_mask(Flag.DELETED).any()


def orphan_splats(session):
    """Take a car's splats out of their instance and select them."""
    session.selection.select((FIRST_CAR + 1,))
    rows = find_selected_rows(session)
    session.document.apply(ReassignSelected(0))
    session.document.apply(SelectRows(rows))
    assert session.selection.ids == ()
    return rows


def test_splats_of_no_instance_can_be_deselected_and_deleted(session):
    rows = orphan_splats(session)
    session.actions.run("select.none")
    assert session.selection.is_empty
    session.history.undo()
    session.actions.run("edit.delete")
    assert session.document.state.find_rows(Flag.DELETED).tolist() == rows.tolist()


def test_splats_of_no_instance_are_outlined(gl, session, snapshot):
    rows = orphan_splats(session)
    renderer = GlRenderer(gl, session.document)
    asked = replace(snapshot, draft=False)
    try:
        renderer.render(asked)
        outlined = renderer.read_picture()
        session.document.apply(SelectRows(rows, "remove"))
        renderer.render(asked)
        assert (renderer.read_picture() != outlined).any(axis=2).mean() > 0.005
    finally:
        renderer.release()


def test_growing_and_inverting_by_command(session):
    session.selection.select((FIRST_CAR,))
    before = len(find_selected_rows(session))
    assert session.actions.run("select.grow")
    assert len(find_selected_rows(session)) > before
    session.history.undo()
    assert session.actions.run("select.invert")
    assert len(find_selected_rows(session)) == len(session.document.scene) - before
    session.actions.run("select.none")
    assert not session.actions.run("select.grow"), "nothing to grow"


def test_a_selection_extends_to_its_classes(session):
    table = session.document.scene.table
    session.selection.select((FIRST_CAR, 30))
    assert session.actions.run("select.class")
    assert set(session.selection.ids) == {i.id for i in table if i.class_name in ("Car", "Tree")}
    assert session.document.history.edits[-1].title == "Select classes Car, Tree"
    session.document.apply(MergeInstances((FIRST_CAR, FIRST_CAR + 1), FIRST_CAR))
    session.selection.select((FIRST_CAR,))
    session.actions.run("select.class")
    assert FIRST_CAR + 2 in session.selection.ids


def test_dashes_cover_half_of_the_line_and_march():
    outline = ((0.0, 0.0), (100.0, 0.0), (100.0, 60.0))
    length = 160 + np.hypot(100, 60)
    for shift in (0.0, 3.0, 1234.5):
        pieces = compute_dashes(outline, shift)
        lengths = np.hypot(pieces[:, 2] - pieces[:, 0], pieces[:, 3] - pieces[:, 1])
        assert lengths.max() <= DASH + 1e-9
        assert lengths.sum() == pytest.approx(length / 2, abs=DASH)
    first, later = compute_dashes(outline, 0.0), compute_dashes(outline, 1.0)
    assert first[1].tolist() == [10, 0, 15, 0]
    assert [11, 0, 16, 0] in later.tolist()
