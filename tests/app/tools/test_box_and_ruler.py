"""Box and ruler as tools: clicks on the scene, drags of handles."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR, ROAD

from instdrive_app.pointer import Click
from instdrive_app.session.aids.box_handles import locate_handles
from instdrive_app.state import resolve
from instdrive_app.tools.registry import create_tools
from instdrive_core.edits.queries.shown_means import compute_shown_means

SIZE = (480, 270)


@pytest.fixture
def snapshot(session):
    return resolve(session.state, *SIZE)


@pytest.fixture
def pixels(session, snapshot):
    """A pixel that shows the first car, and one that shows the road."""
    means, _ = compute_shown_means(session.document, 0.0)
    ids, found = session.document.scene.instance_ids, {}
    for number in (FIRST_CAR, ROAD):
        rows = np.flatnonzero(ids == number)
        places, depth = snapshot.camera.project(means[rows])
        good = (depth > 1) & (depth < 30) & (np.abs(places - (240, 135)) < (200, 110)).all(axis=1)
        row = rows[good][np.argmin(depth[good])]
        found[number] = (*places[good][np.argmin(depth[good])].tolist(), row)
    return found


@pytest.fixture
def tools(session, pixels):
    winners = np.zeros(SIZE[::-1], np.uint32)
    for x, y, row in pixels.values():
        winners[int(y), int(x)] = row + 1
    return create_tools(session, lambda _: winners)


def test_a_click_puts_the_box_around_an_object_or_on_the_ground(session, snapshot, tools, pixels):
    tool = tools["box"]
    x, y, _ = pixels[ROAD]
    assert tool.click(Click(x, y), snapshot) == ROAD
    assert session.aids.box.box.size.tolist() == [session.aids.box.box.size[0]] * 3, "a cube: the road is no object"
    x, y, _ = pixels[FIRST_CAR]
    assert tool.click(Click(x, y), snapshot) == FIRST_CAR
    session.aids.box.select()
    assert FIRST_CAR in session.selection.ids
    tool.click(Click(1.0, 1.0), snapshot)
    assert "something solid" in session.messages.log[-1].text


def test_a_handle_is_dragged_and_escape_gives_the_old_box_back(session, snapshot, tools, pixels):
    tool = tools["box"]
    x, y, _ = pixels[ROAD]
    tool.click(Click(x, y), snapshot)
    before = session.aids.box.box
    at = locate_handles(before, snapshot.camera)["z+"]
    tool.hover(*at, snapshot)
    assert tool.drags
    tool.drag(at, (at[0], at[1] - 20))
    taller = session.aids.box.box
    assert taller.size[2] > before.size[2]
    tool.cancel()
    assert session.aids.box.box is before
    tool.drag(at, (at[0], at[1] - 20))
    tool.release(Click(at[0], at[1] - 20), snapshot)
    tool.cancel()
    assert np.allclose(session.aids.box.box.size, taller.size)
    tool.click(Click(*locate_handles(session.aids.box.box, snapshot.camera)["z+"]), snapshot)
    assert np.allclose(session.aids.box.box.size, taller.size), "a click on a handle places nothing"
    tool.hover(2.0, 2.0, snapshot)
    assert not tool.drags, "elsewhere a drag moves the camera"


def test_two_clicks_measure_and_a_third_begins_anew(session, snapshot, tools, pixels):
    tool, ruler = tools["measure"], session.aids.ruler
    (x, y, car), (u, v, road) = pixels[FIRST_CAR], pixels[ROAD]
    tool.click(Click(x, y), snapshot)
    assert ruler.describe() == ""
    tool.click(Click(u, v), snapshot)
    means = session.document.compute_means(np.array([car, road]))
    assert np.allclose(ruler.points, means, atol=0.2)
    assert float(ruler.describe().split()[0]) == pytest.approx(np.linalg.norm(np.diff(means, axis=0)), abs=0.3)
    assert "Measured" in session.messages.log[-1].text
    tool.click(Click(x, y), snapshot)
    assert len(ruler.points) == 1
    tool.click(Click(1.0, 1.0), snapshot)
    assert len(ruler.points) == 1
    session.actions.run("measure.clear")
    assert not ruler.points
