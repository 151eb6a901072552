"""What lies behind each other: gone through by Alt + wheel or slow clicks, listed; a double click frames."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR, ROAD, procedural_street

from instdrive_app import camera
from instdrive_app.pointer import Click
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import EditorState, resolve
from instdrive_app.tools.pick import PickTool
from instdrive_core.edits.document.document import Document

BLUE_CAR = FIRST_CAR + 1


@pytest.fixture
def session():
    made = EditorSession()
    made.show(Document(procedural_street()))
    yield made
    made.close()


@pytest.fixture
def aim(session):
    """The frame on screen, and where the blue car is in it."""
    view = session.document.scene.views[0]
    snapshot = resolve(EditorState(viewpoint=camera.view_from_camera(view), time=view.time), 480, 270)
    x, y = view.camera.project(np.array([[3.0, 9.4, 0.7]]))[0][0]
    return snapshot, float(x), float(y)


def test_the_wheel_goes_through_all_that_lies_there_and_back(session, aim):
    snapshot, x, y = aim
    tool = PickTool(session)
    first = tool.click(Click(x, y), snapshot)
    assert session.state.stack is None, "one click lists nothing"
    second = tool.cycle(Click(x, y), snapshot, 1)
    stack = session.state.stack
    assert stack.ids[:2] == (first, second)
    assert len(set(stack.ids)) == len(stack.ids) > 1
    assert session.selection.ids == (second,)
    assert tool.cycle(Click(x, y), snapshot, -1) == first
    assert tool.cycle(Click(x, y), snapshot, -1) == stack.ids[-1], "it comes around"


def test_a_slow_second_click_lists_what_it_went_through_and_a_first_one_elsewhere_closes_the_list(session, aim):
    snapshot, x, y = aim
    tool = PickTool(session)
    tool.click(Click(x, y), snapshot)
    second = tool.click(Click(x, y), snapshot)
    assert session.state.stack.ids[session.state.stack.chosen] == second
    tool.click(Click(x - 60, y + 30), snapshot)
    assert session.state.stack is None


def test_a_double_click_frames_what_the_first_click_selected(session, aim):
    snapshot, x, y = aim
    tool = PickTool(session)
    chosen = tool.click(Click(x, y), snapshot)
    assert tool.click(Click(x, y, double=True), snapshot) == chosen
    assert session.selection.ids == (chosen,) != (ROAD,)
    means = session.navigation.compute_world_means((chosen,))
    pixels, depths = session.state.viewpoint.fit_camera(480, 270).project(means)
    assert (depths > 0).all()
    middle = pixels.mean(axis=0)
    np.testing.assert_allclose(middle, [240, 135], atol=40)
