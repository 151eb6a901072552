"""The CPU's renderer against the OpenGL passes, which share nothing with it but constants and the document."""

from itertools import pairwise

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, ROAD

from instdrive_app import camera
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.picking import Picker
from instdrive_app.render.software.renderer import SoftwareRenderer
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_app.state import EditorState, ViewMode, resolve
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.visibility import HideInstances
from instdrive_core.instances.colormap import ids_from_colors

SIZE = (300, 180)
BLUE_CAR = FIRST_CAR + 1
QUARTER_TURN = (0.5**0.5, 0.0, 0.0, 0.5**0.5)


@pytest.fixture
def pair(gl, street):
    """The document drawn by OpenGL and by the CPU."""
    renderers = GlRenderer(gl, street), SoftwareRenderer(gl, street)
    yield renderers
    for renderer in renderers:
        renderer.release()
    assert gl.error == "GL_NO_ERROR"


@pytest.fixture
def software(gl, street):
    made = SoftwareRenderer(gl, street)
    yield made
    made.release()


def state_at(document, index=0, **changes):
    view = document.scene.views[index]
    return EditorState(viewpoint=camera.view_from_camera(view), time=view.time, **changes)


def take_snapshot(document, index=0, **changes):
    return resolve(state_at(document, index, **changes), *SIZE)


def pictures(pair, snapshot):
    shown = []
    for renderer in pair:
        renderer.render(snapshot)
        shown.append(renderer.read_picture().astype(int))
    return shown


def assert_same_picture(pair, snapshot):
    """Within a level of 255 on average, and but for one pixel in a hundred within three."""
    by_gl, by_cpu = pictures(pair, snapshot)
    difference = np.abs(by_gl - by_cpu)
    assert difference.mean() < 0.5
    assert np.quantile(difference.max(axis=2), 0.99) <= 3
    return by_cpu


CHANGES = {
    "recolour": lambda document: (
        document.apply(RecolorInstances((BLUE_CAR,), "tint", (0.9, 0.4, 0.1))),
        document.apply(RecolorInstances((ROAD,), "solid", (0.2, 0.3, 0.2))),
    ),
    "delete and hide": lambda document: (
        document.apply(DeleteInstances((BLUE_CAR,))),
        document.apply(HideInstances((FIRST_CAR,))),
    ),
    "move": lambda document: document.apply(
        MoveInstances((BLUE_CAR, DRIVING_CAR), (-2.0, 1.0, 0.3), rotation=QUARTER_TURN, scale=0.7)
    ),
    "duplicate": lambda document: document.apply(DuplicateInstances((BLUE_CAR,), (-3.0, 2.0, 0.0))),
}


@pytest.mark.parametrize("index", [0, 3, 6])
def test_the_picture_is_that_of_the_opengl_pass(pair, street, index):
    shown = assert_same_picture(pair, take_snapshot(street, index))
    assert shown.std() > 20


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_the_picture_follows_each_edit_and_its_undoing(pair, street, change):
    snapshot = take_snapshot(street)
    before = pictures(pair, snapshot)[1]
    change(street)
    shown = assert_same_picture(pair, snapshot)
    assert (shown != before).any(axis=2).mean() > 0.02
    while street.undo():
        pass
    np.testing.assert_array_equal(pictures(pair, snapshot)[1], before)


def test_the_picture_follows_the_drive(pair, street):
    state = state_at(street, 2)
    shown = []
    for time in (0.0, 1.0, 60.0):  # on its track, further along, gone
        state.time = time
        shown.append(assert_same_picture(pair, resolve(state, *SIZE)))
    assert all((a != b).any() for a, b in pairwise(shown))


@pytest.mark.parametrize("sky", [True, False])
def test_depth_and_the_backdrop_agree(pair, street, sky):
    assert_same_picture(pair, take_snapshot(street, show_sky=sky))
    assert_same_picture(pair, take_snapshot(street, 2, view_mode=ViewMode.DEPTH, show_sky=sky))
    assert pair[0].depth_range == pair[1].depth_range


@pytest.mark.parametrize("mode", [ViewMode.INSTANCE, ViewMode.CODEWORD])
def test_flat_views_decode_to_the_ids_that_clicks_find(software, street, mode):
    snapshot = take_snapshot(street, 1, view_mode=mode)
    software.render(snapshot)
    ids = street.scene.instance_ids if mode is ViewMode.INSTANCE else street.scene.codewords
    expected = np.append(np.uint32(0), ids)[software.read_rows(snapshot)]
    np.testing.assert_array_equal(ids_from_colors(software.read_picture()), expected)
    assert len(np.unique(expected)) >= 8


def test_the_picked_instance_is_that_of_the_id_view_at_500_pixels(software, street):
    snapshot = take_snapshot(street, view_mode=ViewMode.INSTANCE)
    software.render(snapshot)
    shown, picker = ids_from_colors(software.read_picture()), Picker()
    rng = np.random.default_rng(6)
    for x, y in zip(rng.integers(0, SIZE[0], 500).tolist(), rng.integers(0, SIZE[1], 500).tolist(), strict=True):
        row = software.shown.read_row_at(x, y)
        picked = int(street.scene.instance_ids[row]) if row >= 0 else 0
        below = picker.find_instances_at(street, snapshot, float(x), float(y))
        assert picked == shown[y, x] == (below[0] if below else 0), (x, y)


def test_flat_views_follow_merged_instances_and_the_opacity_asked_for(software, street):
    snapshot = take_snapshot(street, view_mode=ViewMode.INSTANCE)
    assert (software.read_instance_ids(snapshot) == FIRST_CAR).any()
    street.apply(MergeInstances((FIRST_CAR,), BLUE_CAR))
    assert not (software.read_instance_ids(snapshot) == FIRST_CAR).any()
    strict = take_snapshot(street, view_mode=ViewMode.INSTANCE, id_opacity=0.95)
    assert (software.read_rows(strict) != software.read_rows(snapshot)).any()


def test_outlines_are_twice_as_wide_where_a_picture_has_twice_the_pixels(pair, street):
    plain = assert_same_picture(pair, take_snapshot(street))
    lines = [
        (assert_same_picture(pair, take_snapshot(street, hovered=FIRST_CAR, pixel_scale=scale)) != plain).any(axis=2)
        for scale in (1.0, 2.0)
    ]
    assert 1.6 < lines[1].sum() / lines[0].sum() < 2.3
    assert lines[1][lines[0]].all()


def test_outlines_follow_selection_and_hovering_without_blending_anew(software, street):
    software.render(take_snapshot(street))
    plain, winner = software.read_picture(), software.read_instance_ids(take_snapshot(street))
    blended = software.frame_seconds
    software.render(take_snapshot(street, hovered=BLUE_CAR))
    hovered = software.read_picture()
    line = (hovered != plain).any(axis=2)
    assert line.any()
    assert not line[winner == BLUE_CAR].any()
    street.apply(SelectInstances((FIRST_CAR,)))
    software.render(take_snapshot(street))
    tinted = (software.read_picture() != plain).any(axis=2)
    assert tinted[winner == FIRST_CAR].mean() > 0.95
    software.render(take_snapshot(street, show_outlines=False))
    np.testing.assert_array_equal(software.read_picture(), plain)
    assert software.frame_seconds == blended, "nothing was blended since"


def test_a_draft_is_smaller_and_nearly_the_same_and_cannot_be_clicked(software, street):
    sharp, draft = take_snapshot(street), resolve(state_at(street), *SIZE, draft=True)
    software.render(sharp)
    full = software.read_picture().astype(float)
    software.render(draft)
    assert software.picture.size == (SIZE[0] // 2, SIZE[1] // 2)
    small = full.reshape(SIZE[1] // 2, 2, SIZE[0] // 2, 2, 3).mean(axis=(1, 3))
    assert np.abs(small - software.read_picture()).mean() < 4
    assert software.shown.read_row_at(10, 10) is None


def test_a_frame_shown_can_be_asked_for_and_one_of_other_rows_cannot_be_clicked(software, street):
    software.render(take_snapshot(street))
    assert software.shown.read_row_at(150, 150) >= 0
    assert software.read_row_at(software.shown, 150, 150) == software.shown.read_row_at(150, 150), "asked for once more"
    street.apply(DuplicateInstances((BLUE_CAR,), (-3.0, 2.0, 0.0)))
    assert software.shown.read_row_at(150, 150) is None


def test_states_handed_over_are_never_written_again(street):
    document, watcher = street, SceneWatcher(street)
    first = watcher.take_state()
    assert watcher.take_state() is first
    kept = {name: np.array(value) for name, value in vars(first).items() if isinstance(value, np.ndarray)}
    for change in CHANGES.values():
        change(document)
        assert watcher.take_state() is not first
        while document.undo():
            watcher.take_state()
    document.apply(MergeInstances((FIRST_CAR,), BLUE_CAR))
    document.apply(HideInstances((ROAD,)))
    later = watcher.take_state()
    for name, value in kept.items():
        np.testing.assert_array_equal(getattr(first, name), value, err_msg=name)
    np.testing.assert_array_equal(later.instance_ids, document.scene.instance_ids)
    np.testing.assert_array_equal(later.flags, document.state.flags)
