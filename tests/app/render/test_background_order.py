"""Orders sorted at once or on a thread of their own, and frames drawn with an order that is out of date."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from procedural_street import FIRST_CAR

from instdrive_app import camera
from instdrive_app.render import depth_order as orders
from instdrive_app.render.depth_order import OrderSorter, sort_by_depth
from instdrive_app.render.gl import gpu_scene
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.state import EditorState, resolve
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import MoveInstances

SIZE = (240, 144)
AXIS = np.array([0.0, 0.0, 1.0, 2.0], np.float32)
NEAR = 0.2


def points(depths):
    means = np.zeros((len(depths), 3), np.float32)
    means[:, 2] = np.asarray(depths, np.float32) - 2
    return means


class Gate:
    """Sorts that wait until they are let through."""

    def __init__(self, monkeypatch):
        self._open, self.calls = threading.Event(), 0
        self._open.set()
        monkeypatch.setattr(orders, "sort_by_depth", self._sort)

    def _sort(self, *arguments):
        self.calls += 1
        assert self._open.wait(120)
        return sort_by_depth(*arguments)

    def shut(self):
        self._open.clear()

    def open(self):
        self._open.set()


@pytest.fixture
def gate(monkeypatch):
    made = Gate(monkeypatch)
    yield made
    made.open()


def eventually(condition):
    end = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_what_is_in_view_comes_farthest_first_then_what_is_behind():
    order = sort_by_depth("key", points([3.0, -1.0, 8.0, 0.1, np.nan, 5.0]), AXIS, NEAR)
    assert order.rows[: order.in_view].tolist() == [2, 5, 0]
    assert sorted(order.rows[order.in_view :].tolist()) == [1, 3]
    near, far = order.depth_range
    assert 2.9 < near < far <= 8.01


def test_nothing_in_view_is_an_order_too():
    for depths in ([], [-1.0]):
        order = sort_by_depth("key", points(depths), AXIS, NEAR)
        assert (order.in_view, len(order.rows)) == (0, len(depths))


def test_soon_gives_the_last_order_until_the_next_is_there_and_sorts_one_at_a_time(gate):
    sorter, means = OrderSorter(), points([3.0, 5.0])
    assert len(sorter.sort_soon("a", means, AXIS, NEAR).rows) == 0, "there is none yet, and nobody waits"
    assert sorter.sort_now("a", means, AXIS, NEAR).key == "a"
    gate.shut()
    for key in "bcd":
        assert sorter.sort_soon(key, means, AXIS, NEAR).key == "a"
    eventually(lambda: gate.calls == 2)
    gate.open()
    eventually(lambda: sorter.sort_soon("d", means, AXIS, NEAR).key == "d")
    assert gate.calls == 3, "c was never sorted: the camera had moved on"
    assert sorter.sort_soon("d", means, AXIS, NEAR) is sorter.sort_now("d", means, AXIS, NEAR)
    sorter.release()


def test_now_waits_for_the_sort_that_runs_and_sorts_what_does_not(gate):
    sorter, means = OrderSorter(), points([3.0, 5.0])
    sorter.sort_now("a", means, AXIS, NEAR)
    gate.shut()
    sorter.sort_soon("b", means, AXIS, NEAR)
    threading.Timer(0.05, gate.open).start()
    assert sorter.sort_now("b", means, AXIS, NEAR).key == "b"
    assert sorter.sort_now("c", means, AXIS, NEAR).key == "c"
    assert gate.calls == 3
    sorter.release()


def test_a_sort_that_fails_is_heard_of(monkeypatch):
    sorter, means = OrderSorter(), points([3.0, 5.0])
    sorter.sort_now("a", means, AXIS, NEAR)

    def fail(*arguments):
        raise MemoryError("no memory to sort")

    monkeypatch.setattr(orders, "sort_by_depth", fail)
    sorter.sort_soon("b", means, AXIS, NEAR)
    with pytest.raises(MemoryError, match="no memory"):
        eventually(lambda: sorter.sort_soon("b", means, AXIS, NEAR).key == "b")
    sorter.release()


@pytest.fixture
def renderer(gl, street):
    made = GlRenderer(gl, street)
    yield made
    made.release()
    assert gl.error == "GL_NO_ERROR"


def take_snapshot(document, index):
    view = document.scene.views[index]
    return resolve(EditorState(viewpoint=camera.view_from_camera(view), time=0.0), *SIZE)


def blend(renderer, snapshot, **options):
    renderer.render(snapshot, **options)
    return renderer.read_blended()


def test_a_frame_never_waits_and_settles_on_the_exact_picture(street, renderer, gate):
    first, second = take_snapshot(street, 0), take_snapshot(street, 1)
    exact = blend(renderer, second)
    ahead = blend(renderer, first, wait=True)
    assert renderer.settled
    gate.shut()
    stale = blend(renderer, second, wait=False)
    assert not renderer.settled
    covered = exact[..., 3] > 0.9
    assert (stale[..., 3] > 0.9)[covered].mean() > 0.99, "all that is in view is drawn, if in the wrong order"
    assert (stale != exact).any()
    np.testing.assert_array_equal(blend(renderer, first, wait=False), ahead)
    assert renderer.settled, "the camera is back where the order is from"
    gate.open()

    def settles():
        renderer.render(second, wait=False)
        return renderer.settled

    eventually(settles)
    np.testing.assert_array_equal(renderer.read_blended(), exact)
    draws = renderer.blended_draws
    renderer.render(second, wait=False)
    assert renderer.blended_draws == draws


def test_a_large_scene_appears_over_some_frames_that_do_not_wait(street, renderer, monkeypatch):
    snapshot = take_snapshot(street, 0)
    monkeypatch.setattr(gpu_scene, "UPLOADED_AT_ONCE", 5000)
    covered = []
    while not renderer.settled:
        covered.append((blend(renderer, snapshot, wait=False)[..., 3] > 0.9).mean())
        time.sleep(0.002)
    assert len(covered) >= 4
    assert covered[0] < 0.9 * covered[-1]
    one_by_one = blend(renderer, snapshot, wait=False)
    fresh = GlRenderer(renderer.picture.ctx, street)
    np.testing.assert_array_equal(one_by_one, blend(fresh, snapshot))
    fresh.release()


def test_an_order_older_than_an_undo_shows_no_row_that_is_gone(street, renderer, gate):
    snapshot = take_snapshot(street, 0)
    before = blend(renderer, snapshot)
    street.apply(DuplicateInstances((FIRST_CAR,), (2.0, 2.0, 0.0)))
    assert (blend(renderer, snapshot) != before).any()
    gate.shut()
    street.undo()
    np.testing.assert_array_equal(blend(renderer, snapshot, wait=False), before)
    assert not renderer.settled
    gate.open()


def test_exact_reads_wait_even_where_frames_do_not(gl, street, renderer, gate):
    snapshot = take_snapshot(street, 0)
    renderer.render(snapshot, wait=False)
    street.apply(MoveInstances((FIRST_CAR,), (1.5, 0.0, 0.0)))
    gate.shut()
    renderer.render(snapshot, wait=False)
    threading.Timer(0.05, gate.open).start()
    ids = renderer.read_instance_ids(snapshot)
    fresh = GlRenderer(gl, street)
    np.testing.assert_array_equal(ids, fresh.read_instance_ids(snapshot))
    fresh.release()


def test_a_moving_camera_keeps_its_order_until_it_has_turned_by_half_a_degree(street, renderer, monkeypatch):
    """A camera that stops gets its exact order, however little it has turned."""
    sorts = []
    real = orders.sort_by_depth
    monkeypatch.setattr(orders, "sort_by_depth", lambda key, *rest: sorts.append(key) or real(key, *rest))
    first = take_snapshot(street, 0)
    renderer.render(first)

    def turned(degrees):
        pose = first.camera.world_from_camera.copy()
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        pose[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose[:3, :3]
        return replace(first, camera=replace(first.camera, world_from_camera=pose))

    for degrees in (0.1, 0.2, 0.3, 0.4):
        renderer.render(turned(degrees), wait=False)
    assert len(sorts) == 1
    assert not renderer.settled

    def settles():
        renderer.render(turned(0.4), wait=False)
        return renderer.settled

    eventually(settles)
    assert len(sorts) == 2
    np.testing.assert_array_equal(renderer.read_blended(), blend(renderer, turned(0.4)))
    renderer.render(turned(1.2), wait=False)
    eventually(lambda: len(sorts) == 3)
