"""The viewport's picture: who draws it, what is shown while a frame is under way, and what pointing reads."""

import threading
import time

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, procedural_street

from instdrive_app import camera
from instdrive_app.pointer import Click
from instdrive_app.render import frame_renderer, live_view, renderer_trial
from instdrive_app.render.frame_renderer import CHOICE, choose_renderer_kind
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.live_view import SETTLE_SECONDS, LiveView
from instdrive_app.render.picking import Picker
from instdrive_app.render.software import renderer as software
from instdrive_app.render.software.draw import SoftwareDraw
from instdrive_app.render.software.renderer import SoftwareRenderer
from instdrive_app.render.software.thread import LatestFrame
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import EditorState
from instdrive_app.tools.pick import PickTool
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.errors import OptionError

SIZE = (240, 136)
PATIENCE = 120.0
"""Seconds until a picture that never comes counts as a fault."""
BLUE_CAR = FIRST_CAR + 1


@pytest.mark.parametrize(
    ("driver", "kind"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", "cpu"),
        ("softpipe", "cpu"),
        ("SWR (LLVM 10.0, 256 bits)", "cpu"),
        ("Apple Software Renderer", "cpu"),
        ("NVIDIA GeForce RTX 3060/PCIe/SSE2", "gl"),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", "gl"),
        ("AMD Radeon RX 6600 (radeonsi, navi23, LLVM 15.0.6)", "gl"),
    ],
)
def test_the_driver_chooses_the_renderer_and_the_environment_overrules_it(driver, kind):
    assert choose_renderer_kind(driver, {}) == kind
    assert choose_renderer_kind(driver, {CHOICE: " GL "}) == "gl"
    assert choose_renderer_kind(driver, {CHOICE: "cpu"}) == "cpu"
    with pytest.raises(OptionError, match="INSTDRIVE_RENDERER is 'vulkan'"):
        choose_renderer_kind(driver, {CHOICE: "vulkan"})


@pytest.fixture(params=["gl", "cpu"])
def view(gl, monkeypatch, request):
    monkeypatch.setenv(CHOICE, request.param)
    made = LiveView(gl)
    yield made
    made.release()
    assert gl.error == "GL_NO_ERROR"


@pytest.fixture
def cpu_view(gl, monkeypatch):
    monkeypatch.setenv(CHOICE, "cpu")
    made = LiveView(gl)
    yield made
    made.release()


def state_at(document, index=0, **changes):
    seen = document.scene.views[index]
    return EditorState(viewpoint=camera.view_from_camera(seen), time=seen.time, **changes)


def settle(view, document, state, size=SIZE):
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        picture = view.show(document, state, *size)
        if view.settled:
            return picture
    raise AssertionError("the view does not settle")


def test_every_renderer_shows_picture_depth_and_instances(view, street):
    state = state_at(street)
    picture = settle(view, street, state)
    assert isinstance(view.renderer, (GlRenderer, SoftwareRenderer))
    assert picture is view.renderer.picture
    pixels = view.renderer.read_picture()
    assert pixels.shape == (*SIZE[::-1], 3)
    assert pixels.std() > 20
    assert view.frame_seconds > 0
    rows = view.renderer.read_rows(view.snapshot)
    y, x = np.argwhere(rows > 0)[len(rows)].tolist()
    row = int(rows[y, x]) - 1
    assert view.renderer.read_row_at(view.snapshot, x, y) == row
    place = view.snapshot.camera.camera_from_world @ np.append(street.scene.gaussians.means[row], 1)
    if street.scene.nodes[row] == 0:
        assert view.measure_depth_at(x, y) == pytest.approx(place[2], rel=1e-5)
    assert view.measure_depth_at(SIZE[0] / 2, 1) is None, "the sky"
    assert {FIRST_CAR, BLUE_CAR} <= set(np.unique(view.renderer.read_instance_ids(view.snapshot)))


def test_depth_follows_the_drive(view, street):
    state = state_at(street, 3)
    settle(view, street, state)
    ids = view.renderer.read_instance_ids(view.snapshot)
    y, x = np.argwhere(ids == DRIVING_CAR).mean(axis=0).round().astype(int).tolist()
    assert ids[y, x] == DRIVING_CAR
    pose, _ = street.scene.find_node_poses(state.time)
    center = view.snapshot.camera.camera_from_world @ pose[street.scene.nodes.max()][:, 3]
    assert view.measure_depth_at(x, y) == pytest.approx(center[2], abs=3.0)


def test_another_document_and_another_size(view, street):
    state = state_at(street)
    settle(view, street, state)
    first = view.renderer
    picture = settle(view, street, state, (100, 60))
    assert picture.size == (100, 60)
    assert view.snapshot.camera.width == 100
    other = Document(procedural_street(0.3))
    settle(view, other, state)
    assert view.renderer is not first


@pytest.fixture
def slow(monkeypatch):
    """The CPU's frames wait until they are let go."""
    gate, draw = threading.Event(), SoftwareDraw.__call__

    def held(self, request, newer=lambda: None):
        assert gate.wait(PATIENCE)
        return draw(self, request, newer)

    monkeypatch.setattr(software, "SoftwareDraw", type("Held", (SoftwareDraw,), {"__call__": held}))
    yield gate
    gate.set()


@pytest.fixture
def patience(monkeypatch):
    """How long each look for a frame would have waited at most, in seconds."""
    asked, take = [], LatestFrame.take

    def noted(self, patience=0.0):
        asked.append(patience)
        return take(self, patience)

    monkeypatch.setattr(LatestFrame, "take", noted)
    return asked


def test_nobody_waits_for_a_frame_and_what_is_shown_is_what_pointing_reads(slow, cpu_view, street, patience):
    state, view = state_at(street), cpu_view
    for _ in range(5):
        assert view.show(street, state, *SIZE).size == (1, 1), "a plain backdrop"
    assert len(patience) == 5
    assert max(patience) < 0.05, "no longer than a window's frame may take"
    assert view.snapshot is None
    assert not view.settled
    slow.set()
    settle(view, street, state)
    shown, slow_again = view.snapshot, slow
    slow_again.clear()
    later = state_at(street, 5)
    view.show(street, later, *SIZE)
    assert view.snapshot is shown, "the newer frame is under way"
    assert not view.settled
    ids = np.append(np.uint32(0), street.scene.instance_ids)[shown.winner + 1]
    y, x = np.argwhere(ids == BLUE_CAR)[20]
    session = EditorSession()
    session.show(street)
    assert PickTool(session).click(Click(float(x), float(y)), view.snapshot) == BLUE_CAR
    session.close()
    slow_again.set()
    settle(view, street, later)
    assert view.snapshot is not shown
    np.testing.assert_array_equal(view.snapshot.camera.world_from_camera, later.viewpoint.world_from_camera)


def test_clicks_read_the_frame_and_ask_the_splats_only_where_it_cannot_tell(cpu_view, street, monkeypatch):
    asked, instances_at = [], Picker.find_instances_at

    def counted(self, *arguments):
        asked.append(arguments)
        return instances_at(self, *arguments)

    monkeypatch.setattr(Picker, "find_instances_at", counted)
    session = EditorSession()
    session.show(street)
    tool, state = PickTool(session), state_at(street)
    settle(cpu_view, street, state)
    snapshot = cpu_view.snapshot
    ids = np.append(np.uint32(0), street.scene.instance_ids)[snapshot.winner + 1]
    y, x = np.argwhere(ids == BLUE_CAR).mean(axis=0).round().astype(int).tolist()
    tool.hover(x, y, snapshot)
    assert session.state.hovered == BLUE_CAR
    assert tool.click(Click(float(x), float(y)), snapshot) == BLUE_CAR
    assert tool.click(Click(SIZE[0] / 2, 1.0), snapshot) == 0, "the sky"
    assert not asked
    for _ in range(2):
        tool.click(Click(float(x), float(y)), snapshot)
    assert asked, "for the next one behind"
    for edit in (DeleteInstances((BLUE_CAR,)), DuplicateInstances((FIRST_CAR,), (1.0, 0.0, 0.0))):
        asked.clear()
        street.apply(edit)
        assert tool.click(Click(float(x), float(y)), snapshot) != BLUE_CAR
        assert asked, "the frame shown is of before"
    session.close()


def test_a_moving_camera_gets_drafts_and_a_still_one_a_sharp_picture(cpu_view, street, monkeypatch):
    monkeypatch.setattr("instdrive_app.render.live_view.SMOOTH_SECONDS", 0.0)  # nothing is fast enough
    view, state = cpu_view, state_at(street)
    settle(view, street, state)
    session = EditorSession()
    session.show(street)
    drafts, end = 0, time.monotonic() + PATIENCE
    while drafts < 3 and time.monotonic() < end:
        state.viewpoint = camera.look(state.viewpoint, 0.01, 0.0)
        view.show(street, state, *SIZE)
        drafts += view.snapshot.draft
        if view.snapshot.draft:
            assert not view.settled
            assert view.renderer.picture.size == (SIZE[0] // 2, SIZE[1] // 2)
            PickTool(session).hover(100, 100, view.snapshot)
            assert session.state.hovered == 0
    assert drafts == 3
    time.sleep(SETTLE_SECONDS)
    assert settle(view, street, state).size == SIZE
    session.close()


def test_what_the_render_thread_raises_reaches_the_window(cpu_view, street, monkeypatch):
    def broken(self, request, newer):
        raise MemoryError("no room for the picture")

    monkeypatch.setattr(SoftwareDraw, "__call__", broken)
    with pytest.raises(MemoryError, match="no room"):
        settle(cpu_view, street, state_at(street))


def wait_until(done, view, document, state):
    deadline = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < deadline
        view.show(document, state, *SIZE)
        time.sleep(0.002)


@pytest.mark.parametrize("gain", [1e9, 0.0], ids=["the CPU is faster", "OpenGL is faster"])
def test_the_faster_renderer_stays_whatever_the_driver_is_called(gl, street, monkeypatch, gain):
    """A driver whose name promises a GPU draws slowly; what the CPU draws beside it is measured, once."""
    monkeypatch.delenv(CHOICE, raising=False)
    monkeypatch.setattr(frame_renderer, "SOFTWARE_DRIVERS", ())
    monkeypatch.setattr(renderer_trial, "GAIN", gain)
    monkeypatch.setattr(live_view, "SMOOTH_SECONDS", 0.0)
    made, state = LiveView(gl), EditorState(viewpoint=camera.view_from_camera(street.scene.views[0]))
    assert made.backend != "CPU"
    wait_until(lambda: made._was_tried, made, street, state)
    assert not made.settled
    wait_until(lambda: made._trial is None, made, street, state)
    assert (made.backend == "CPU") == isinstance(made.renderer, SoftwareRenderer) == (gain > 0)
    wait_until(lambda: made.settled, made, street, state)
    row = made.find_row_at(SIZE[0] / 2, SIZE[1] - 10)
    assert row is not None
    street.apply(DeleteInstances((FIRST_CAR,)))
    made.show(street, state, *SIZE)
    wait_until(lambda: made.settled, made, street, state)
    assert made._trial is None, "it is tried once"
    made.release()
    assert gl.error == "GL_NO_ERROR"


def test_nothing_is_tried_where_the_environment_has_chosen(gl, street, monkeypatch):
    monkeypatch.setenv(CHOICE, "gl")
    monkeypatch.setattr(live_view, "SMOOTH_SECONDS", 0.0)
    made, state = LiveView(gl), EditorState(viewpoint=camera.view_from_camera(street.scene.views[0]))
    wait_until(lambda: made.snapshot is not None and made.settled and made.frame_seconds, made, street, state)
    made.show(street, state, *SIZE)
    assert not made._was_tried
    made.release()
