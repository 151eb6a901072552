"""Selecting by ranges of values, and floaters of the whole scene, without a window."""

import time

import numpy as np
import pytest
from session_driver import finish

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.splat_values import SPLAT_VALUES, Viewing, find_plain_colors
from instdrive_core.scene.scene import scene_from_gaussians
from instdrive_core.scene.selection import Flag

HERE = Viewing(np.zeros(3), 0.0)


def selected(session):
    return session.document.state.find_rows(Flag.SELECTED)


@pytest.mark.parametrize("value", SPLAT_VALUES, ids=lambda value: value.name)
def test_a_range_selects_exactly_what_lies_in_it_and_is_one_step(session, value):
    chosen, document = session.filter, session.document
    chosen.choose(value.name)
    low, high = chosen.find_limits()
    steps = document.history.cursor
    middle = (low + high) / 2
    for end in np.linspace(high, middle, 5)[1:]:
        chosen.select_range(low, float(end))
    assert document.history.cursor == steps + 1, "one step, however often the slider moves"
    values = value.compute(document, Viewing(session.state.viewpoint.position, session.state.time))
    np.testing.assert_array_equal(selected(session), np.flatnonzero((values <= middle) & document.state.drawn))
    assert chosen.range == (low, middle)
    chosen.choose(value.name)
    assert chosen.range == (low, high)
    chosen.select_range(low, high)
    assert len(selected(session)) == len(document.scene), "the ends let everything in"
    assert document.history.cursor == steps + 2


def test_the_histogram_counts_what_is_drawn(session):
    assert session.filter.count_bins().sum() == len(session.document.scene)
    session.deletion.delete(session.document.find_visible_instances()[:1])
    assert session.filter.count_bins().sum() == session.document.state.drawn.sum()


def test_hue_and_brightness_are_those_of_the_colour(street):
    colors = find_plain_colors(street)
    values = {value.name: value.compute(street, HERE) for value in SPLAT_VALUES}
    red = colors[:, 0] > 2 * colors[:, 1:].max(axis=1)
    assert red.sum() > 100
    off = np.abs((values["hue"][red] + 180) % 360 - 180)
    assert (off < 60).all()
    assert (values["saturation"][red] > 0.5).all()


def test_columns_of_the_file_can_be_selected_by(session):
    scene = session.document.scene
    scene.extra["confidence"] = np.linspace(0, 1, len(scene)).astype(np.float32)
    names = [value.name for value in session.filter.choices]
    assert names[-1] == "column confidence"
    session.filter.choose("column confidence")
    session.filter.select_range(0.5, 2.0)
    assert len(selected(session)) == pytest.approx(len(scene) / 2, abs=1)


def with_floaters(scene):
    """The street with four splats of each kind; returns the document and their rows by kind."""
    gaussians = scene.gaussians.copy()
    solid = np.flatnonzero(scene.nodes == 0)
    rows = {kind: solid[100 * number : 100 * number + 4] for number, kind in enumerate(("alone", "faint", "needle"), 1)}
    gaussians.log_scales[solid] = np.log(0.05)
    gaussians.opacity_logits[solid] = 2.0
    gaussians.means[rows["alone"]] += np.float32([[0, 0, 50], [0, 0, 80], [0, 60, 60], [0, -60, 70]])
    gaussians.opacity_logits[rows["faint"]] = -6
    gaussians.log_scales[rows["needle"], 0] = np.log(4.0)
    return Document(scene_from_gaussians(gaussians.select(solid))), {
        kind: np.searchsorted(solid, places) for kind, places in rows.items()
    }


def test_floaters_are_found_by_kind_shown_and_deleted(session, street):
    document, rows = with_floaters(street.scene)
    session.show(document)
    finish(session)
    assert session.actions.run("select.floaters")
    finish(session)
    found = selected(session)
    for kind, places in rows.items():
        assert np.isin(places, found).all(), kind
    assert len(found) < 0.05 * len(document.scene), "what belongs to things stays"
    assert "floaters found" in session.messages.log[-1].text
    session.deletion.delete_selection()
    assert not document.state.drawn[rows["alone"]].any()
    session.history.undo()
    assert document.state.drawn.all()


def test_a_range_of_a_million_splats_follows_the_slider(session, street):
    gaussians = street.scene.gaussians
    tiles = -(-1_000_000 // len(gaussians))
    session.show(Document(scene_from_gaussians(gaussians.select(np.tile(np.arange(len(gaussians)), tiles)))))
    finish(session)
    chosen = session.filter
    chosen.choose("size")
    low, high = chosen.find_limits()
    took = []
    for end in np.linspace(high, low, 8)[1:-1]:
        begun = time.perf_counter()
        chosen.select_range(low, float(end))
        took.append(time.perf_counter() - begun)
    assert len(selected(session)) > 0
    assert min(took) < 0.06, "30 ms on two free cores, see benchmarks.editor"
