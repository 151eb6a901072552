"""The OpenGL view of an edited document against the view of the same document baked, and against a fresh upload."""

from copy import deepcopy

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, HOUSES, ROAD, procedural_street
from random_scene import random_scene

from instdrive_app import camera
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.gl.splat_textures import WIDTH
from instdrive_app.state import EditorState, ViewMode, Viewpoint, resolve
from instdrive_core.edits.bases.adjustments import RANGES
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteSelected
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reassign import ReassignSelected
from instdrive_core.edits.kinds.relative_adjustment import AdjustInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.kinds.visibility import HideInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag

SIZE = (240, 144)
BLUE_CAR = FIRST_CAR + 1
TURN = (0.9, 0.05, -0.1, 0.4)

EDITS = {
    "move": [MoveInstances((BLUE_CAR,), (-1.0, 1.5, 0.4), rotation=TURN, scale=1.3)],
    "move twice": [
        MoveInstances((FIRST_CAR, BLUE_CAR), (0.5, 1.0, 0.0), rotation=TURN),
        MoveInstances((BLUE_CAR,), (-1.0, 0.0, 0.5), scale=0.7),
    ],
    "move an actor": [MoveInstances((DRIVING_CAR,), (-1.0, -2.0, 0.2), rotation=TURN, scale=1.2, time=0.5)],
    "turn the scene": [
        MoveInstances((BLUE_CAR,), (-1.0, 1.5, 0.4), rotation=TURN),
        TurnScene((0.99, 0.04, -0.03, 0.1), 0.9),
        MoveInstances((FIRST_CAR, DRIVING_CAR), (0.5, 0.5, 0.0)),
    ],
    "duplicate": [DuplicateInstances((BLUE_CAR,), (-2.5, 1.0, 0.0))],
    "duplicate an actor": [DuplicateInstances((DRIVING_CAR,), (-1.0, -3.0, 0.0))],
    "duplicate what was moved and recoloured": [
        MoveInstances((BLUE_CAR,), (-1.0, 0.0, 0.0), rotation=TURN),
        AdjustInstances((BLUE_CAR,), "hue", 120.0),
        DuplicateInstances((BLUE_CAR,), (0.0, 4.0, 0.0)),
    ],
    "insert": [InsertScene("other.ply", (-0.5, 6.0, 1.0))],
    "recolour": [
        RecolorInstances((BLUE_CAR,), "tint", (0.9, 0.4, 0.1)),
        RecolorInstances((ROAD,), "solid", (0.8, 0.1, 0.2)),
    ],
    **{f"adjust {what}": [AdjustInstances((BLUE_CAR, ROAD), what, 0.35)] for what in RANGES},
    "hide all but the copy": [DuplicateInstances((BLUE_CAR,), (-2.0, 0.0, 0.0)), HideInstances((BLUE_CAR,))],
    "delete": [DeleteInstances((FIRST_CAR, HOUSES))],
    "merge": [MergeInstances((FIRST_CAR,), BLUE_CAR)],
    "split": [MergeInstances((FIRST_CAR,), BLUE_CAR), SplitInstance(BLUE_CAR)],
    "reassign": [SelectInstances((BLUE_CAR,)), ReassignSelected(FIRST_CAR)],
    "fade, move, copy and delete what was there": [
        AdjustInstances((BLUE_CAR,), "opacity", 0.5),
        MoveInstances((BLUE_CAR,), (-1.5, 0.0, 0.3), rotation=TURN),
        DuplicateInstances((BLUE_CAR, DRIVING_CAR), (0.5, 2.0, 0.0)),
        SelectInstances((BLUE_CAR,)),
        DeleteSelected(),
    ],
}


@pytest.fixture
def street(street):
    """View-dependent enough that a moved car whose colour does not turn shows."""
    rng = np.random.default_rng(5)
    rest = street.scene.gaussians.sh_rest
    rest += rng.normal(0, 0.25, rest.shape).astype(np.float32)
    other = random_scene(count=150, degree=3)
    other.gaussians.means *= 0.3
    other.gaussians.log_scales += 1
    street.open_scene = lambda path: other
    return street


@pytest.fixture
def renderer(gl, street):
    made = GlRenderer(gl, street)
    yield made
    made.release()
    assert gl.error == "GL_NO_ERROR"


def state_at(document, index, **changes):
    view = document.scene.views[index]
    return EditorState(viewpoint=camera.view_from_camera(view), time=view.time, **changes)


def look(renderer, snapshot):
    renderer.render(snapshot)
    return renderer.read_blended(), renderer.read_instance_ids(snapshot)


def draw_afresh(gl, document, snapshot):
    renderer = GlRenderer(gl, document)
    pictures = look(renderer, snapshot)
    renderer.release()
    return pictures


def assert_same_look(left, right):
    (left_blend, left_ids), (right_blend, right_ids) = left, right
    error = np.abs(left_blend - right_blend)
    assert error.mean() < 1e-4
    assert np.quantile(error, 0.999) < 5e-3
    assert (left_ids == right_ids).mean() > 0.999


@pytest.mark.parametrize("edits", EDITS.values(), ids=EDITS.keys())
def test_an_edit_shows_what_baking_it_would(gl, renderer, street, edits):
    snapshot = resolve(state_at(street, 2), *SIZE)
    before = look(renderer, snapshot)
    for edit in deepcopy(edits):
        street.apply(edit)
    after = look(renderer, snapshot)
    assert any((a != b).mean() > 1e-3 for a, b in zip(after, before, strict=True)), "the edit is seen"
    if not street.state.find_mask(Flag.HIDDEN).any():  # hiding is a way of looking, not part of what is exported
        assert_same_look(after, draw_afresh(gl, Document(bake_document(street, snapshot.time)), snapshot))
    for one, fresh in zip(after, draw_afresh(gl, street, snapshot), strict=True):
        np.testing.assert_array_equal(one, fresh, err_msg="what was uploaded step by step is what is there")
    for _ in edits:
        street.undo()
    for one, original in zip(look(renderer, snapshot), before, strict=True):
        np.testing.assert_array_equal(one, original)
    for _ in edits:
        street.redo()
    for one, done in zip(look(renderer, snapshot), after, strict=True):
        np.testing.assert_array_equal(one, done)


def test_edited_tracks_hold_at_every_time(gl, renderer, street):
    state = state_at(street, 0)
    renderer.render(resolve(state, *SIZE))
    street.apply(MoveInstances((DRIVING_CAR,), (-1.0, 0.0, 0.0), rotation=(1.0, 0.0, 0.0, 0.3)))
    street.apply(DuplicateInstances((DRIVING_CAR,), (0.0, -4.0, 0.0)))
    for time in (0.0, 1.25, 3.0, 0.0):
        state.time = time
        snapshot = resolve(state, *SIZE)
        assert_same_look(look(renderer, snapshot), draw_afresh(gl, Document(bake_document(street, time)), snapshot))


@pytest.mark.parametrize("scale", [1.0, 1.6])
def test_a_moved_car_seen_from_the_same_side_looks_the_same(renderer, street, scale):
    others = tuple(i for i in street.find_visible_instances() if i != BLUE_CAR)
    street.apply(HideInstances(others))
    state = state_at(street, 0, show_sky=False)
    before, ids = look(renderer, resolve(state, *SIZE))
    move = MoveInstances((BLUE_CAR,), (5.0, -3.0, 1.0), rotation=TURN, scale=scale)
    matrix = move.compute_matrix(street)
    street.apply(move)
    pose = state.viewpoint.world_from_camera.copy()
    pose[:3, 3] = matrix[:, :3] @ pose[:3, 3] + matrix[:, 3]
    pose[:3, :3] = matrix[:, :3] / scale @ pose[:3, :3]
    state.viewpoint = Viewpoint(pose, state.viewpoint.lens)
    after, moved_ids = look(renderer, resolve(state, *SIZE))
    assert (ids == BLUE_CAR).mean() > 0.02
    assert (ids == moved_ids).mean() > 0.999
    error = np.abs(after - before)[ids == BLUE_CAR]
    assert error.mean() < 1e-3
    assert np.quantile(error, 0.99) < 2e-2


def test_rows_beyond_the_first_texture_row_and_beyond_its_spare_are_kept(gl):
    """Many copies, each seen; the textures grow several times."""
    document = Document(procedural_street(spacing=0.5))
    renderer = GlRenderer(gl, document)
    snapshot = resolve(state_at(document, 0), *SIZE)
    look(renderer, snapshot)
    for step in range(12):
        document.apply(DuplicateInstances((ROAD, BLUE_CAR, HOUSES), (0.0, 0.5 * step, 0.2)))
        look(renderer, snapshot)
    assert len(document.scene) * 3 > 2 * WIDTH
    for one, fresh in zip(look(renderer, snapshot), draw_afresh(gl, document, snapshot), strict=True):
        np.testing.assert_array_equal(one, fresh)
    for _ in range(12):
        document.undo()
    document.apply(DuplicateInstances((FIRST_CAR,), (1.0, 0.0, 0.0)))
    for one, fresh in zip(look(renderer, snapshot), draw_afresh(gl, document, snapshot), strict=True):
        np.testing.assert_array_equal(one, fresh)
    renderer.release()


@pytest.mark.parametrize("mode", [ViewMode.INSTANCE, ViewMode.CODEWORD])
def test_flat_views_follow_copies(gl, renderer, street, mode):
    snapshot = resolve(state_at(street, 2, view_mode=mode), *SIZE)
    renderer.render(snapshot)
    before = renderer.read_picture()
    street.apply(DuplicateInstances((BLUE_CAR,), (-2.5, 1.0, 0.0)))
    street.apply(MergeInstances((FIRST_CAR,), ROAD))
    renderer.render(snapshot)
    fresh = GlRenderer(gl, street)
    fresh.render(snapshot)
    np.testing.assert_array_equal(renderer.read_picture(), fresh.read_picture())
    assert (renderer.read_picture() != before).any()
    fresh.release()


def test_a_scene_that_had_nothing_shows_what_is_inserted(gl, street):
    street_scene = street.scene
    empty = Scene(
        street_scene.gaussians.select(slice(0, 0)),
        *(getattr(street_scene, name)[:0] for name in ("instance_ids", "codewords", "nodes")),
        views=street_scene.views,
    )
    document = Document(empty)
    document.open_scene = lambda path: street_scene
    renderer, snapshot = GlRenderer(gl, document), resolve(state_at(document, 0), *SIZE)
    renderer.render(snapshot)
    assert not renderer.read_instance_ids(snapshot).any()
    document.apply(InsertScene("street.ply"))
    assert len(np.unique(renderer.read_instance_ids(snapshot))) > 8
    document.undo()
    assert not renderer.read_instance_ids(snapshot).any()
    renderer.release()
