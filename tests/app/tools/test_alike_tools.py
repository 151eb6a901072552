"""Selecting what is like a clicked splat, by colour alone and by colour and connection."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR
from session_driver import finish
from test_region_tools import find_selected_rows, session, snapshot, tools  # noqa: F401

from instdrive_app.pointer import Click
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.edits.queries.splat_values import find_plain_colors


@pytest.fixture
def red_place(session, snapshot, tools):  # noqa: F811
    """A pixel and a row of the red car's body."""
    document, colors = session.document, find_plain_colors(session.document)
    winners = tools["flood"]._winners(snapshot.__class__(**{**vars(snapshot), "draft": False}))
    rows = winners.astype(int) - 1
    is_red = (rows >= 0) & (document.scene.instance_ids[rows] == FIRST_CAR) & (colors[rows, 0] > 0.5)
    y, x = np.argwhere(is_red & (colors[rows, 1] < 0.3))[0]
    return float(x), float(y), int(rows[y, x])


def test_colour_selects_everywhere_and_flood_only_what_hangs_together(session, snapshot, tools, red_place):  # noqa: F811
    x, y, row = red_place
    found, colors = {}, find_plain_colors(session.document)
    session.state.color_tolerance = 0.25
    for name in ("eyedropper", "flood"):
        tools[name].click(Click(x, y), snapshot)
        finish(session)
        found[name] = find_selected_rows(session)
        assert (np.abs(colors[found[name]] - colors[row]) <= 0.25).all()
        assert row in found[name]
    assert set(found["flood"]) < set(found["eyedropper"])
    ids = session.document.scene.instance_ids
    assert (ids[found["flood"]] == FIRST_CAR).mean() > 0.99, "no other car is near enough"
    assert len(found["flood"]) > 50
    assert len(np.unique(ids[found["eyedropper"]])) > 1
    tools["flood"].click(Click(x, y, ctrl=True), snapshot)
    finish(session)
    assert not len(find_selected_rows(session))
    session.history.undo()
    assert len(find_selected_rows(session)) == len(found["flood"])


def test_stricter_colours_select_less_and_nothing_is_told(session, snapshot, tools, red_place):  # noqa: F811
    x, y, _ = red_place
    counts = []
    for _ in range(2):
        tools["eyedropper"].click(Click(x, y), snapshot)
        finish(session)
        counts.append(len(find_selected_rows(session)))
        for _ in range(6):
            session.actions.run("alike.stricter")
    assert 0 < counts[1] < counts[0]
    tools["eyedropper"].click(Click(240.0, 1.0), snapshot)
    assert "no splat here" in session.messages.log[-1].text


def test_a_sphere_selects_around_its_middle_and_nothing_behind(session, snapshot, tools, red_place):  # noqa: F811
    x, y, row = red_place
    session.state.region_splats = True
    means, _ = compute_shown_means(session.document, snapshot.time)
    depth = float(snapshot.camera.project(means[row][None])[1][0])
    tool, radius = tools["sphere"], snapshot.camera.fx / depth  # a metre
    tool.drag((x, y), (x + radius, y))
    assert len(tool.outline) > 10
    tool.release(Click(x + radius, y), snapshot)
    rows = find_selected_rows(session)
    away = np.linalg.norm(means - means[row], axis=1)
    np.testing.assert_allclose(away[rows].max(), 1.0, atol=0.1)
    assert len(rows) == (away <= 1.0).sum()
    session.state.region_splats = False
    tool.drag((x, y), (x + 5 * radius, y))
    tool.release(Click(x + 5 * radius, y), snapshot)
    assert FIRST_CAR in session.selection.ids
    steps = session.document.history.cursor
    tool.drag((240.0, 1.0), (260.0, 1.0))
    tool.release(Click(260.0, 1.0), snapshot)
    assert session.document.history.cursor == steps
    assert "needs a splat" in session.messages.log[-1].text
