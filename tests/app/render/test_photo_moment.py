"""Beside a photo, what drives is shown where the photo has it: drawn by either renderer, picked and brushed."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, procedural_street

from instdrive_app import camera
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.picking import Picker
from instdrive_app.render.software.draw import FrameRequest, SoftwareDraw
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_app.state import EditorState, Reference, resolve
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.shown_means import compute_shown_means
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import PhotoLag

SIZE = (240, 136)
LATE = 0.3
"""Seconds from the time step's boxes to the photo."""


@pytest.fixture
def document():
    """A street of which photo 0 was taken later than the boxes of its time step."""
    scene = procedural_street()
    first, *others = scene.views
    late = PhotoLag.look_from(np.zeros(3), 0.0, 1e-9, 0.0, LATE)
    lagging = replace(first, camera=replace(first.camera, lag=late))
    return Document(replace(scene, views=(lagging, *others)))


def look_through(document, reference):
    view = document.scene.views[0]
    viewpoint = replace(camera.view_from_camera(view), lag=view.camera.lag)
    state = EditorState(viewpoint=viewpoint, time=view.time, dataset_view=0, reference=reference)
    return resolve(state, *SIZE)


def expect(document, asked):
    """The instance that each pixel stands for, with what drives where the photo has it."""
    return build_instance_map(document.scene, view_scene(document.scene, asked.camera, asked.time))


def test_the_car_is_elsewhere_beside_the_photo_only(document):
    plain, beside = look_through(document, Reference.NONE), look_through(document, Reference.PHOTO)
    assert plain.camera.lag is None
    assert beside.camera.lag == document.scene.views[0].camera.lag
    here, there = expect(document, plain), expect(document, beside)
    assert ((here == DRIVING_CAR) != (there == DRIVING_CAR)).sum() > 20
    np.testing.assert_array_equal(there, expect(document, replace(plain, time=plain.time + LATE)))


def test_the_cpu_draws_it_there(document):
    draw, watcher = SoftwareDraw(), SceneWatcher(document)
    for reference in (Reference.NONE, Reference.PHOTO, Reference.NONE):
        asked = look_through(document, reference)
        winner = draw(FrameRequest(watcher.take_state(), asked)).winner
        found = np.where(winner >= 0, document.scene.instance_ids[winner], 0)
        assert (found == expect(document, asked)).mean() > 0.995


def test_opengl_draws_it_there(gl, document):
    renderer = GlRenderer(gl, document)
    for reference in (Reference.NONE, Reference.PHOTO, Reference.NONE):
        asked = look_through(document, reference)
        assert (renderer.read_instance_ids(asked) == expect(document, asked)).mean() > 0.99
    renderer.release()


def test_clicks_and_brushes_find_it_there(document):
    picker = Picker()
    for reference in (Reference.NONE, Reference.PHOTO, Reference.NONE):
        asked = look_through(document, reference)
        rows, columns = np.nonzero(expect(document, asked) == DRIVING_CAR)
        place = len(rows) // 2
        found = picker.find_below(document, asked, columns[place] + 0.5, rows[place] + 0.5)
        assert found.seen[0] == DRIVING_CAR
    asked = look_through(document, Reference.PHOTO)
    later = compute_shown_means(document, asked.time + LATE)[0]
    np.testing.assert_allclose(compute_shown_means(document, asked.time, asked.camera.lag)[0], later, atol=1e-5)
