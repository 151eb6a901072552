"""The OpenGL passes against the CPU rasterizer, which shares nothing with them but the constants."""

import ctypes
import time

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, ROAD

from instdrive_app import camera
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.state import ID_ALPHA_CUT, EditorState, ViewMode, resolve
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.visibility import HideInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.instances.colormap import ID_LIMIT, colors_from_ids, ids_from_colors
from instdrive_core.maths.spherical_harmonics import evaluate_view_colors
from instdrive_core.rasterize.preview import PickRule, render_preview

SIZE = (300, 180)
NEAREST_SOLID = PickRule(nearest=True)
"""The rule of the ID pass, which draws views of instances and outlines while the camera moves."""


@pytest.fixture
def renderer(gl, street):
    made = GlRenderer(gl, street)
    yield made
    made.release()
    assert gl.error == "GL_NO_ERROR"


def state_at(document, index, **changes):
    view = document.scene.views[index]
    return EditorState(viewpoint=camera.view_from_camera(view), time=view.time, **changes)


def cpu_frame(document, snapshot, rule=NEAREST_SOLID):
    """The edited document, baked at the moment, drawn by the CPU rasterizer."""
    scene = bake_document(document, snapshot.time)
    gaussians = scene.gaussians
    directions = gaussians.means - snapshot.camera.position.astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    colors = evaluate_view_colors(gaussians.sh_dc, gaussians.sh_rest, directions)
    shape = (gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacities)
    return render_preview(*shape, colors, snapshot.camera, rule=rule, instances=scene.instance_ids)


def edit_street(document):
    document.apply(RecolorInstances((FIRST_CAR + 1,), "tint", (0.9, 0.4, 0.1)))
    document.apply(RecolorInstances((ROAD,), "solid", (0.2, 0.3, 0.2)))
    document.apply(DeleteInstances((FIRST_CAR,)))


@pytest.mark.parametrize("index", [0, 3, 6])
@pytest.mark.parametrize("change", [lambda document: None, edit_street], ids=["as trained", "edited"])
def test_color_equals_the_cpu_rasterizer(gl, renderer, street, index, change):
    change(street)
    snapshot = resolve(state_at(street, index), *SIZE)
    renderer.render(snapshot)
    frame = cpu_frame(street, snapshot)
    sky = street.scene.sky.sample(snapshot.camera.compute_ray_directions())
    expected = np.concatenate([frame.color + (1 - frame.alpha[..., None]) * sky, frame.alpha[..., None]], axis=2)
    error = np.abs(renderer.read_blended() - expected)
    assert error.mean() < 1.5e-3  # half floats; half a level of 255 is 2e-3
    assert np.quantile(error, 0.999) < 1e-2
    shown = renderer.read_picture() / 255
    assert np.abs(shown - expected[..., :3].clip(0, 1)).mean() < 3e-3
    exact = GlRenderer(gl, street, in_full_floats=True)
    exact.render(snapshot)
    error = np.abs(exact.read_blended() - expected)
    exact.release()
    assert error.mean() < 1e-4
    assert np.quantile(error, 0.999) < 5e-3


def test_depth_equals_the_cpu_rasterizer(renderer, street):
    snapshot = resolve(state_at(street, 2, view_mode=ViewMode.DEPTH), *SIZE)
    renderer.render(snapshot)
    blended, frame = renderer.read_blended(), cpu_frame(street, snapshot)
    solid = frame.alpha > 0.5
    error = np.abs(blended[..., 0][solid] / blended[..., 3][solid] / frame.depth[solid] - 1)
    assert np.quantile(error, 0.999) < 5e-3
    near, far = renderer.depth_range
    assert near < np.median(frame.depth[solid]) < far


@pytest.mark.parametrize("index", [0, 5])
def test_pixels_stand_for_the_splats_of_the_cpu_rasterizer(renderer, street, index):
    snapshot = resolve(state_at(street, index), *SIZE)
    rows = renderer.read_rows(snapshot).astype(np.int64) - 1
    winners = cpu_frame(street, snapshot, PickRule(min_alpha=ID_ALPHA_CUT)).winner  # nothing is deleted: rows agree
    assert (rows == winners).mean() > 0.999  # harmonics do not count, thresholds within rounding do
    shown = [renderer.read_row_at(snapshot, x, y) for x, y in ((10, 170), (150, 100), (150, 2))]
    assert shown == [None if row < 0 else row for row in (winners[170, 10], winners[100, 150], winners[2, 150])]


@pytest.mark.parametrize("index", [0, 5])
def test_the_nearest_solid_splats_are_shown_until_it_is_known_what_pixels_stand_for(renderer, street, index):
    snapshot = resolve(state_at(street, index, view_mode=ViewMode.INSTANCE), *SIZE)
    renderer.scene.update(snapshot.time)
    renderer._projector.sort(renderer.scene, snapshot.camera, wait=True)
    with_none = np.append(street.scene.instance_ids, np.uint32(0))
    renderer.render(snapshot, wait=False)
    assert not renderer.settled
    nearest = with_none[cpu_frame(street, snapshot).winner]
    assert (ids_from_colors(renderer.read_picture()) == nearest).mean() > 0.999
    deadline = time.monotonic() + 60
    while not renderer.settled:
        assert time.monotonic() < deadline
        renderer.render(snapshot, wait=False)
        time.sleep(0.002)
    expected = with_none[cpu_frame(street, snapshot, PickRule(min_alpha=ID_ALPHA_CUT)).winner]
    assert (ids_from_colors(renderer.read_picture()) == expected).mean() > 0.999
    assert (expected != nearest).mean() > 0.01


@pytest.mark.parametrize("mode", [ViewMode.INSTANCE, ViewMode.CODEWORD])
def test_flat_views_decode_to_exact_ids(renderer, street, mode):
    snapshot = resolve(state_at(street, 0, view_mode=mode), *SIZE)
    renderer.render(snapshot)
    rows = renderer.read_rows(snapshot)
    ids = street.scene.instance_ids if mode is ViewMode.INSTANCE else street.scene.codewords
    expected = np.append(np.uint32(0), ids)[rows]
    np.testing.assert_array_equal(ids_from_colors(renderer.read_picture()), expected)
    assert len(np.unique(expected)) >= 8


@pytest.mark.parametrize("mode", [ViewMode.INSTANCE, ViewMode.CODEWORD])
def test_every_id_has_the_color_of_the_bijection(gl, street, mode):
    rng, scene = np.random.default_rng(6), street.scene
    scene.instance_ids = rng.integers(1, ID_LIMIT, len(scene), np.uint32)
    scene.codewords = rng.integers(0, 1 << 32, len(scene), np.uint32)
    renderer, snapshot = GlRenderer(gl, street), resolve(state_at(street, 0, view_mode=mode), *SIZE)
    renderer.render(snapshot)
    rows = renderer.read_rows(snapshot)
    ids = scene.instance_ids if mode is ViewMode.INSTANCE else scene.codewords % ID_LIMIT
    expected = colors_from_ids(np.append(np.uint32(0), ids)[rows])
    assert len(np.unique(rows)) > 2000
    np.testing.assert_array_equal(renderer.read_picture(), expected)
    renderer.release()


def test_hidden_and_deleted_instances_vanish_and_undo_restores_every_pixel(renderer, street):
    snapshot = resolve(state_at(street, 0), *SIZE)
    renderer.render(snapshot)
    before = renderer.read_picture()
    for edit in (HideInstances((FIRST_CAR,)), DeleteInstances((FIRST_CAR + 1,))):
        street.apply(edit)
    renderer.render(snapshot)
    assert (renderer.read_picture() != before).any(axis=2).mean() > 0.1
    assert not np.isin(renderer.read_instance_ids(snapshot), [FIRST_CAR, FIRST_CAR + 1]).any()
    street.undo()
    street.undo()
    renderer.render(snapshot)
    np.testing.assert_array_equal(renderer.read_picture(), before)


def test_an_actor_moves_with_time_and_is_absent_outside_its_track(renderer, street):
    state = state_at(street, 0)
    places = []
    for moment in (0.0, 1.0):
        state.time = moment
        places.append(np.argwhere(renderer.read_instance_ids(resolve(state, *SIZE)) == DRIVING_CAR).mean(axis=0))
    assert np.linalg.norm(places[0] - places[1]) > 3
    state.time = 60.0
    assert not (renderer.read_instance_ids(resolve(state, *SIZE)) == DRIVING_CAR).any()


def test_merged_instances_change_their_color(renderer, street):
    snapshot = resolve(state_at(street, 0, view_mode=ViewMode.INSTANCE), *SIZE)
    renderer.render(snapshot)
    assert (ids_from_colors(renderer.read_picture()) == FIRST_CAR).any()
    street.apply(MergeInstances((FIRST_CAR,), FIRST_CAR + 1))
    renderer.render(snapshot)
    assert not (ids_from_colors(renderer.read_picture()) == FIRST_CAR).any()


def test_outlines_surround_what_is_selected_and_hovered(renderer, street):
    state = state_at(street, 0)
    renderer.render(resolve(state, *SIZE))
    plain = renderer.read_picture()
    street.apply(SelectInstances((FIRST_CAR + 1,)))
    state.hovered = FIRST_CAR
    renderer.render(resolve(state, *SIZE))
    changed = (renderer.read_picture() != plain).any(axis=2)
    ids = renderer.read_instance_ids(resolve(state, *SIZE))
    assert changed[ids == FIRST_CAR + 1].mean() > 0.95  # tinted
    assert changed[ids == FIRST_CAR].mean() < 0.2  # outlined only
    state.view_mode = ViewMode.INSTANCE
    renderer.render(resolve(state, *SIZE))
    inside = ids_from_colors(renderer.read_picture()) == ids
    assert inside[ids == FIRST_CAR + 1].all(), "ID colours stay exact under a selection"
    state.view_mode, state.show_outlines = ViewMode.COLOR, False
    renderer.render(resolve(state, *SIZE))
    np.testing.assert_array_equal(renderer.read_picture(), plain)


def test_splats_are_blended_only_when_the_picture_changes(renderer, street):
    state = state_at(street, 0)
    renderer.render(resolve(state, *SIZE))
    street.apply(SelectInstances((FIRST_CAR,)))
    state.hovered = FIRST_CAR
    renderer.render(resolve(state, *SIZE))
    assert renderer.blended_draws == 1
    street.apply(DeleteInstances((FIRST_CAR,)))
    renderer.render(resolve(state, *SIZE))
    assert renderer.blended_draws == 2


def test_frames_are_timed_without_waiting_for_them(gl, renderer, street):
    """The time is known at the next frame; a frame in which nothing was blended does not count."""
    state = state_at(street, 0)
    renderer.render(resolve(state, *SIZE))
    renderer.render(resolve(state, *SIZE))
    seconds = renderer.frame_seconds
    assert 0 < seconds < 60
    renderer.render(resolve(state, *SIZE))
    assert renderer.frame_seconds == seconds
    other = GlRenderer(gl, street)
    renderer.render(resolve(state_at(street, 3), *SIZE))
    other.render(resolve(state, *SIZE))  # takes the context's timer
    renderer.render(resolve(state, *SIZE))
    assert 0 < renderer.frame_seconds < 60
    other.release()


def test_a_draft_is_a_coarser_picture_of_the_same(renderer, street):
    state = state_at(street, 0)
    renderer.render(resolve(state, *SIZE))
    sharp = renderer.read_picture().astype(float)
    renderer.render(resolve(state, *SIZE, draft=True))
    assert renderer.read_blended().shape == (SIZE[1] // 2, SIZE[0] // 2, 4)
    assert 0 < np.abs(renderer.read_picture() - sharp).mean() < 2.5


@pytest.mark.parametrize("mode", list(ViewMode))
def test_every_pass_leaves_gl_as_it_was(gl, renderer, street, mode):
    street.apply(SelectInstances((FIRST_CAR,)))
    before = gl_state()
    renderer.render(resolve(state_at(street, 0, view_mode=mode), *SIZE))
    assert gl_state() == before
    assert gl.error == "GL_NO_ERROR"


def gl_state():
    """Flags and functions as the driver reports them."""
    library = ctypes.CDLL("libGL.so.1")
    flags = {"BLEND": 0x0BE2, "DEPTH_TEST": 0x0B71, "SCISSOR_TEST": 0x0C11, "RASTERIZER_DISCARD": 0x8C89}
    values = {"FRAMEBUFFER": 0x8CA6, "BLEND_SRC": 0x80C9, "BLEND_DST": 0x80C8, "DEPTH_FUNC": 0x0B74}
    state = {name: bool(library.glIsEnabled(number)) for name, number in flags.items()}
    for name, number in values.items():
        found = ctypes.c_int(-1)
        library.glGetIntegerv(number, ctypes.byref(found))
        state[name] = found.value
    return state
