"""A large scene is looked at while it is being opened: from sketch to whole, or back to what was open before."""

import dataclasses
import threading
import time
from functools import partial

import numpy as np
import pytest
from random_scene import random_scene
from session_driver import errors, finish

from instdrive_app import camera
from instdrive_app.session.files import opening
from instdrive_app.session.requests import OfferCleanup
from instdrive_core.errors import DataError
from instdrive_core.formats.registry import save_scene, sketch_scene
from instdrive_core.progress import report


class Gate:
    """Holds the reading of scenes back until it is opened."""

    def __init__(self, monkeypatch):
        self.opened, self.failure = threading.Event(), None
        self._read = opening.open_document
        monkeypatch.setattr(opening, "open_document", self.read)
        monkeypatch.setattr(opening, "sketch_scene", partial(sketch_scene, most=300))

    def read(self, path, **options):
        while not self.opened.wait(0.002):
            report(0.25)
        if self.failure is not None:
            raise self.failure
        return self._read(path, **options)


@pytest.fixture
def gate(monkeypatch):
    return Gate(monkeypatch)


@pytest.fixture
def large(tmp_path):
    """A scene of many splats, for this test."""
    save_scene(tmp_path / "large.ply", dataclasses.replace(random_scene(2, 3000, actors=0), sky=None, views=()))
    return tmp_path / "large.ply"


def wait_for_sketch(session):
    end = time.monotonic() + 60
    while session.sketches.shown is None:
        assert time.monotonic() < end, "no sketch came"
        session.tick(0.0)
        time.sleep(0.002)


def look_aside(session):
    session.navigation.look_from(camera.look(session.state.viewpoint, 0.3, 0.1))
    return session.state.viewpoint


def test_the_whole_is_seen_from_where_its_sketch_was(session, street, gate, large):
    session.files.open(large)
    wait_for_sketch(session)
    assert len(session.sketches.shown.document.scene) == 300
    assert session.document is street, "the document is another only when all is read"
    seen = session.state.viewpoint
    gate.opened.set()
    finish(session)
    assert session.sketches.shown is None
    assert len(session.document.scene) == 3000
    assert session.state.viewpoint is seen


def test_who_has_looked_around_stays_there_and_the_start_view_is_the_sketchs(session, gate, large):
    session.files.open(large)
    wait_for_sketch(session)
    start = session.state.viewpoint
    turned = look_aside(session)
    gate.opened.set()
    finish(session)
    assert session.state.viewpoint is turned
    session.navigation.look_from_start()
    np.testing.assert_array_equal(session.state.viewpoint.world_from_camera, start.world_from_camera)


@pytest.mark.parametrize("end", ["cancelled", "damaged"])
def test_a_scene_that_is_not_opened_leaves_the_one_before_as_it_was(session, street, gate, large, end):
    session.navigation.set_time(1.0)
    before = session.state.viewpoint, session.state.dataset_view, session.state.time
    session.files.open(large)
    wait_for_sketch(session)
    look_aside(session)
    if end == "cancelled":
        session.jobs.cancel()
    else:
        gate.failure = DataError(large, "the file ends after 1024 of 3000 splats", "Export the file again")
        gate.opened.set()
    finish(session)
    session.tick(0.0)
    assert session.sketches.shown is None
    assert session.document is street
    assert (session.state.viewpoint, session.state.dataset_view, session.state.time) == before
    assert (end == "damaged") == any("ends after 1024 of 3000" in text for text in errors(session))


def test_edits_wait_for_the_whole_scene(session, street, gate, large):
    session.files.open(large)
    wait_for_sketch(session)
    session.selection.select((10,))
    assert not street.history.edits
    assert errors(session) == ["Please wait until the current task has finished"]
    gate.opened.set()
    finish(session)


def test_small_scenes_are_opened_at_once(session, tmp_path):
    save_scene(tmp_path / "small.ply", dataclasses.replace(random_scene(2, 300, actors=0), sky=None, views=()))
    session.files.open(tmp_path / "small.ply")
    while session.jobs.current is not None:
        assert session.sketches.shown is None
        session.tick(0.0)


def test_defects_of_large_scenes_are_told_when_they_are_found(session, tmp_path, monkeypatch):
    scene = dataclasses.replace(random_scene(2, 300, actors=0), sky=None, views=())
    scene.gaussians.log_scales[7] = np.nan
    save_scene(tmp_path / "odd.ply", scene)
    monkeypatch.setattr(opening, "MOST_LINTED", 100)
    session.files.open(tmp_path / "odd.ply")
    finish(session)
    assert session.requests.take(OfferCleanup) is not None
    assert [defect.rows.tolist() for defect in session.files.defects if defect.kind == "not_finite"] == [[7]]
