"""The path tool's clicks and drags in the view: keys, the way, the ground, and other things."""

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR

from instdrive_app.pointer import Click
from instdrive_app.state import resolve
from instdrive_app.tools.path import PathTool


@pytest.fixture
def tool(session):
    """The tool, over the street from above, with the driving car selected."""
    session.navigation.look_down(())
    session.selection.select((DRIVING_CAR,))
    session.state.tool = "path"
    return PathTool(session)


@pytest.fixture
def pixel(session):
    """Where a place of the road is in the picture."""

    def find(x, y):
        return tuple(use(session).camera.project(np.array([[x, y, 0.0]]))[0][0].tolist())

    return find


def use(session):
    return resolve(session.state, 800, 900)


def test_the_left_button_drags_keys_and_else_the_camera(session, tool, pixel):
    snapshot = use(session)
    tool.hover(*pixel(-2.5, 20.0), snapshot)
    assert not tool.drags
    tool.hover(*pixel(1.2, 21.0), snapshot)
    assert tool.drags
    tool.drag(pixel(1.2, 21.0), pixel(1.2, 21.0))
    tool.drag(pixel(1.2, 21.0), pixel(-1.0, 22.0))
    tool.release(Click(0, 0), snapshot)
    tool.cancel()
    last = session.ways.keys[-1]
    assert (last.x, last.y) == pytest.approx((-1.0, 22.0), abs=0.1)
    assert session.document.history.done[-1].title == f"Drive instance {DRIVING_CAR} another way"


def test_escape_gives_a_drag_up(session, tool, pixel):
    steps = session.document.history.cursor
    tool.hover(*pixel(1.2, 21.0), use(session))
    tool.drag(pixel(1.2, 21.0), pixel(-1.0, 22.0))
    tool.cancel()
    assert session.document.history.cursor == steps
    assert session.ways.keys[-1].x == pytest.approx(1.2)


def test_clicks_choose_add_and_go_on(session, tool, pixel):
    tool.click(Click(*pixel(1.2, 21.0)), use(session))
    assert session.ways.chosen == 1
    tool.click(Click(*pixel(1.2, 16.0)), use(session))
    assert len(session.ways.keys) == 3
    assert session.ways.keys[1].y == pytest.approx(16.0, abs=0.3)
    tool.click(Click(*pixel(1.2, 27.0)), use(session))
    assert len(session.ways.keys) == 4
    assert session.ways.keys[-1].y == pytest.approx(27.0, abs=0.2)
    tool.click(Click(*pixel(3.0, 8.0)), use(session))
    assert session.selection.ids == (FIRST_CAR + 1,), "a click on another thing selects it"
