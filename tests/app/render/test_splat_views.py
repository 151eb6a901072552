"""Centres and rings: both renderers draw the same, and pointing means what it means elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import FIRST_CAR

from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.shown_frame import find_shown_instance
from instdrive_app.render.software.renderer import SoftwareRenderer
from instdrive_app.state import EditorState, ViewMode, resolve


def draw(renderer, snapshot):
    renderer.render(snapshot)
    return renderer.read_picture().astype(int)


@pytest.mark.parametrize("mode", [ViewMode.CENTERS, ViewMode.RINGS])
def test_both_renderers_agree(gl, street, mode):
    state = EditorState()
    state.viewpoint = replace(state.viewpoint, pivot_distance=12.0)
    state.view_mode = mode
    snapshot = resolve(state, 200, 120)
    pictures = []
    for kind in (GlRenderer, SoftwareRenderer):
        renderer = kind(gl, street)
        pictures.append(draw(renderer, snapshot))
        state.id_opacity = 0.99
        assert (draw(renderer, resolve(state, 200, 120)) != pictures[-1]).any(), "the slider leaves faint splats out"
        state.id_opacity = snapshot.id_opacity
        state.view_mode = ViewMode.COLOR
        plain = draw(renderer, resolve(state, 200, 120))
        state.view_mode = mode
        assert np.array_equal(draw(renderer, snapshot), pictures[-1]), "and back"
        assert (np.abs(plain - pictures[-1]).max(axis=2) > 10).mean() > 0.2
        renderer.release()
    one, other = pictures
    assert (np.abs(one - other).max(axis=2) > 24).mean() < 0.06
    assert one.std() > 10


def test_pointing_between_dots_is_left_to_the_splats(gl, street):
    state = EditorState()
    state.view_mode = ViewMode.CENTERS
    renderer = SoftwareRenderer(gl, street)
    renderer.render(resolve(state, 160, 90))
    assert find_shown_instance(street, renderer.shown, 80.0, 45.0) is None
    state.view_mode = ViewMode.RINGS
    renderer.render(resolve(state, 160, 90))
    assert find_shown_instance(street, renderer.shown, 80.0, 45.0) is not None
    renderer.release()
    assert FIRST_CAR in street.scene.table
