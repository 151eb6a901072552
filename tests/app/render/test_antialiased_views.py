"""A scene that is marked as antialiased: both renderers, the ID view and clicks draw it so."""

import numpy as np
import pytest
from clicks import clicks_that_miss

from instdrive_app import camera
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.software.renderer import SoftwareRenderer
from instdrive_app.state import EditorState, resolve
from instdrive_core.rasterize.scene_view import view_scene

SIZE = (240, 136)


@pytest.fixture
def marked(street):
    """From far away, where most splats are smaller than a pixel."""
    street.scene.antialiased = True
    street.scene.gaussians.log_scales -= np.float32(1.0)
    return street


def take_snapshot(document):
    view = document.scene.views[0]
    return resolve(EditorState(viewpoint=camera.view_from_camera(view), time=view.time), *SIZE)


def test_opengl_and_the_cpu_draw_the_same_and_less_than_unmarked(gl, marked):
    snapshot = take_snapshot(marked)
    by_gl, by_cpu = GlRenderer(gl, marked), SoftwareRenderer(gl, marked)
    by_gl.render(snapshot)
    by_cpu.render(snapshot)
    difference = np.abs(by_gl.read_picture().astype(int) - by_cpu.read_picture())
    assert difference.mean() < 0.5
    assert np.quantile(difference.max(axis=2), 0.99) <= 3
    expected = view_scene(marked.scene, snapshot.camera, snapshot.time).alpha
    alpha = by_gl.read_blended()[..., 3]
    assert np.abs(alpha - expected).mean() < 1.5e-3  # half floats
    by_gl.release()
    by_cpu.release()
    marked.scene.antialiased = False
    assert view_scene(marked.scene, snapshot.camera, snapshot.time).alpha.mean() > 1.02 * expected.mean()


def test_clicks_find_the_winner_of_the_frame(marked):
    assert clicks_that_miss(marked, take_snapshot(marked), 150) == 0
