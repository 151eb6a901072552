"""Brush and polygon without a window: what they select, how deep, and what gives them up."""

import time
from dataclasses import replace

import numpy as np
import pytest
from procedural_street import FIRST_CAR
from test_region_tools import SIZE, find_selected_rows, session, snapshot, tools  # noqa: F401

from instdrive_app.camera import orbit
from instdrive_app.pointer import Click
from instdrive_core.edits.queries.brush import mark_stroke, project_for_brush
from instdrive_core.edits.queries.shown_means import compute_shown_means


@pytest.fixture
def projected(session, snapshot):  # noqa: F811
    means, _ = compute_shown_means(session.document, snapshot.time)
    return project_for_brush(means, snapshot.camera, 0.1)


def place_of(session, projected, instance=FIRST_CAR):  # noqa: F811
    """The middle of an instance in the picture, and the depth of its nearest splat."""
    rows = session.document.find_rows((instance,))
    x, y = np.nanmedian(projected[rows, :2], axis=0)
    return float(x), float(y)


def stroke(tool, snapshot, path, **keys):  # noqa: F811
    tool.hover(*path[0], snapshot)
    for point in path[1:]:
        tool.drag(path[0], point)
    tool.release(Click(*path[-1], **keys), snapshot)


def test_projection_agrees_with_the_camera(session, snapshot, projected):  # noqa: F811
    means, _ = compute_shown_means(session.document, snapshot.time)
    pixels, depths = snapshot.camera.project(means)
    before = depths >= 0.1
    np.testing.assert_allclose(projected[before, :2], pixels[before], rtol=1e-4, atol=0.02)
    assert np.isnan(projected[~before]).all()


def test_the_brush_paints_splats_no_deeper_than_its_limit(session, snapshot, tools, projected):  # noqa: F811
    state = session.state
    state.region_splats, state.region_visible_only, state.brush_radius = True, False, 8.0
    x, y = place_of(session, projected)
    counts = []
    for depth in (0.1, 1.0, 500.0):
        state.brush_depth = depth
        stroke(tools["brush"], snapshot, [(x - 12, y), (x, y), (x + 12, y)])
        rows = find_selected_rows(session)
        counts.append(len(rows))
        offset = np.abs(projected[rows, :2] - [x, y])
        assert (offset <= [20.1, 8.1]).all()
    assert 0 < counts[0] < counts[1] < counts[2]
    assert tools["brush"].trail == ()
    steps = session.document.history.cursor
    stroke(tools["brush"], snapshot, [(x, y), (x + 5, y)], ctrl=True)
    assert len(find_selected_rows(session)) < counts[2]
    session.history.undo()
    assert session.document.history.cursor == steps
    assert len(find_selected_rows(session)) == counts[2]


def test_the_brush_takes_whole_instances_that_it_touches(session, snapshot, tools, projected):  # noqa: F811
    session.state.region_splats, session.state.brush_radius = False, 3.0
    x, y = place_of(session, projected)
    stroke(tools["brush"], snapshot, [(x, y), (x + 4, y)])
    assert FIRST_CAR in session.selection.ids
    tools["brush"].hover(x, y, snapshot)
    tools["brush"].drag((x, y), (x + 9, y))
    assert len(tools["brush"].trail) == 2
    tools["brush"].cancel()
    tools["brush"].release(Click(x, y), snapshot)
    assert FIRST_CAR in session.selection.ids, "a stroke that was given up selects nothing"


def test_keys_change_the_brush_within_limits(session):  # noqa: F811
    before = session.state.brush_radius
    session.actions.run("brush.larger")
    assert session.state.brush_radius > before
    for _ in range(60):
        session.actions.run("brush.smaller")
        session.actions.run("brush.deeper")
    assert session.state.brush_radius == 2.0
    assert session.state.brush_depth == 512.0


def test_a_move_of_the_brush_over_a_million_splats_takes_less_than_a_frame():
    rng = np.random.default_rng(0)
    projected = np.c_[rng.random((1_000_000, 2)) * 1000, np.ones(1_000_000)].astype(np.float32)
    marks = np.zeros(len(projected), np.bool_)
    mark_stroke(projected, (0.0, 0.0), (1.0, 0.0), 5.0, 2.0, marks)
    begun, times = time.perf_counter(), []
    for step in range(10):
        begun = time.perf_counter()
        mark_stroke(projected, (100.0 + step, 100.0), (110.0 + step, 104.0), 24.0, 2.0, marks)
        times.append(time.perf_counter() - begun)
    assert marks.sum() > 1000
    assert min(times) < 0.016


def test_a_polygon_is_set_corner_by_corner(session, snapshot, tools, projected):  # noqa: F811
    tool = tools["polygon"]
    session.state.region_splats, session.state.region_visible_only = True, False
    x, y = place_of(session, projected)
    corners = [(x - 30, y - 30), (x + 30, y - 30), (x, y + 30)]
    for corner in corners:
        tool.click(Click(*corner), snapshot)
    tool.hover(x, y, snapshot)
    assert tool.outline == (*corners, (x, y))
    assert find_selected_rows(session).size == 0
    tool.click(Click(corners[0][0] + 2, corners[0][1]), snapshot)
    rows = find_selected_rows(session)
    assert len(rows) > 20
    assert (projected[rows, 1] < y + 30).all()
    assert tool.outline == ()


def test_a_polygon_is_given_up_where_the_camera_moves(session, snapshot, tools):  # noqa: F811
    tool = tools["polygon"]
    for corner in ((10, 10), (100, 10)):
        tool.click(Click(*corner), snapshot)
    turned = orbit(session.state.viewpoint, 0.2, 0.0)
    other = replace(snapshot, camera=turned.fit_camera(*SIZE))
    tool.hover(50, 50, other)
    assert tool.outline == ()


def test_two_corners_enclose_nothing(session, snapshot, tools):  # noqa: F811
    tool = tools["polygon"]
    tool.click(Click(10, 10), snapshot)
    tool.click(Click(100, 10), snapshot)
    tool.release(Click(50, 50), snapshot)
    assert tool.outline == ()
    assert session.document.history.cursor == 0
