"""The thread that draws: only the latest frame, nobody waits, nothing is lost."""

import threading

import pytest

from instdrive_app.render.software.thread import LatestFrame, Superseded

PATIENCE = 120.0
"""Seconds until a thread that never comes counts as a fault."""


class Draw:
    """Draws numbers: each is held until it is let go."""

    def __init__(self):
        self.begun, self.let_go, self.drawn = threading.Semaphore(0), threading.Semaphore(0), []

    def __call__(self, asked, newer):
        self.begun.release()
        assert self.let_go.acquire(timeout=PATIENCE)
        if newer() == "instead":
            raise Superseded
        if asked == "wrong":
            raise ValueError("cannot be drawn")
        self.drawn.append(asked)
        return asked


@pytest.fixture
def drawing():
    draw, woken = Draw(), threading.Semaphore(0)
    frames = LatestFrame(draw, woken.release)
    yield draw, frames, woken
    for _ in range(10):
        draw.let_go.release()
    frames.close()
    assert not any(thread.name == "software-renderer" for thread in threading.enumerate())


def test_taking_returns_at_once_while_a_frame_is_under_way(drawing):
    draw, frames, woken = drawing
    frames.ask(1)
    assert draw.begun.acquire(timeout=PATIENCE)
    assert frames.take() is None
    assert frames.busy, "it is still under way"
    draw.let_go.release()
    assert woken.acquire(timeout=PATIENCE)
    assert frames.take() == 1
    assert frames.take() is None, "each is taken once"


def test_only_the_latest_of_the_frames_asked_for_meanwhile_is_drawn(drawing):
    draw, frames, _ = drawing
    frames.ask(1)
    assert draw.begun.acquire(timeout=PATIENCE)
    for frame in (2, 3, 4):
        frames.ask(frame)
    draw.let_go.release()
    draw.let_go.release()
    assert frames.wait() == 4
    assert draw.drawn == [1, 4]
    assert not frames.busy


def test_a_frame_that_is_superseded_is_given_up(drawing):
    draw, frames, _ = drawing
    frames.ask(1)
    assert draw.begun.acquire(timeout=PATIENCE)
    frames.ask("instead")
    draw.let_go.release()
    draw.let_go.release()
    assert frames.wait() == "instead"
    assert draw.drawn == ["instead"]


def test_what_drawing_raises_reaches_who_asked_and_the_thread_goes_on(drawing):
    draw, frames, _ = drawing
    frames.ask("wrong")
    draw.let_go.release()
    with pytest.raises(ValueError, match="cannot be drawn"):
        frames.wait()
    frames.ask(5)
    draw.let_go.release()
    assert frames.wait() == 5


def test_patience_ends_with_the_frame_or_the_time(drawing):
    draw, frames, _ = drawing
    frames.ask(1)
    assert draw.begun.acquire(timeout=PATIENCE)
    assert frames.take(0.05) is None
    assert frames.busy, "it is still under way"
    threading.Timer(0.05, draw.let_go.release).start()
    assert frames.take(1e6) == 1, "the tests' time limit is much shorter"
