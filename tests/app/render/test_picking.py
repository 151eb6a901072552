"""Clicks: the rasterizer's pixel rule, cycling, modifiers."""

from copy import deepcopy
from itertools import pairwise

import numpy as np
import pytest
from clicks import clicks_that_miss
from procedural_street import DRIVING_CAR, FIRST_CAR, HOUSES, ROAD, float32_gaussians, procedural_street

from instdrive_app import camera
from instdrive_app.pointer import Click
from instdrive_app.render.gl.renderer import GlRenderer
from instdrive_app.render.picking import Picker
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import EditorState, resolve
from instdrive_app.tools.pick import PickTool
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.relative_adjustment import AdjustInstances
from instdrive_core.edits.kinds.visibility import HideInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.instances.shadows import LEARNED_SHADOW, SYNTHETIC
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.activations import logit
from instdrive_core.scene.gaussians import concatenate_gaussians
from instdrive_core.scene.scene import Scene

SIZE = (480, 270)
BLUE_CAR = FIRST_CAR + 1
FLOATER = 99


def take_snapshot(document, index=0):
    view = document.scene.views[index]
    return resolve(EditorState(viewpoint=camera.view_from_camera(view), time=view.time), *SIZE)


def find_pixel(document, point, index=0):
    x, y = document.scene.views[index].camera.project(np.array([point], float))[0][0]
    return float(x), float(y)


def with_floater(opacity, size):
    """The street with one splat in front of the blue car's rear."""
    street = procedural_street()
    where = np.array([3.0, 5.0, 0.9])
    floater = float32_gaussians(
        where[None],
        [[1, 0, 0, 0]],
        np.log([[size] * 3]),
        logit(np.array([opacity])),
        [[1, 1, 1]],
        np.zeros((1, 3, 3)),
        np.zeros((1, 0)),
    )
    gaussians = concatenate_gaussians([street.gaussians, floater])
    ids = np.append(street.instance_ids, np.uint32(FLOATER))
    nodes, codes = np.append(street.nodes, np.uint16(0)), np.append(street.codewords, np.uint32(0))
    table = build_instance_table(ids, gaussians.means, codes, nodes)
    scene = Scene(gaussians, ids, codes, nodes, table, street.actors, street.sky, street.views, code_bits=8)
    return Document(scene), where


def test_clicks_go_through_shadows_as_the_frame_does(street):
    is_car = street.scene.instance_ids == BLUE_CAR
    street.scene.gaussians.opacity_logits[is_car] = logit(np.array([0.05]))
    street.scene.extra[SYNTHETIC] = np.where(is_car, LEARNED_SHADOW, 0).astype(np.uint8)
    x, y = find_pixel(street, (3.0, 5.0, 0.9))
    below = Picker().find_below(street, take_snapshot(street), x, y)
    assert below.seen[0] not in (0, BLUE_CAR)
    assert clicks_that_miss(street, take_snapshot(street), 250) == 0


@pytest.mark.parametrize("index", [0, 5])
def test_clicks_find_the_winner_of_the_cpu_frame(street, index):
    assert clicks_that_miss(street, take_snapshot(street, index), 250) == 0


def test_clicks_agree_with_what_a_gpu_shows_at_every_pixel(gl, street):
    snapshot, picker, renderer = take_snapshot(street), Picker(), GlRenderer(gl, street)
    shown = renderer.read_instance_ids(snapshot)
    renderer.release()
    places = np.random.default_rng(8).integers(0, SIZE, (500, 2))
    agreed = 0
    for x, y in places.tolist():
        below = picker.find_instances_at(street, snapshot, x + 0.5, y + 0.5)
        agreed += (below[0] if below else 0) == shown[y, x]
    assert agreed >= 498  # a fragment whose alpha is 0.2 to the last bit may fall on either side


def test_a_floater_before_a_car_does_not_win_on_a_gpu_either(gl):
    document, where = with_floater(opacity=0.42, size=0.12)
    snapshot = take_snapshot(document)
    x, y = find_pixel(document, where)
    renderer = GlRenderer(gl, document)
    assert renderer.read_instance_ids(snapshot)[int(y), int(x)] == BLUE_CAR
    renderer.release()
    assert Picker().find_instances_at(document, snapshot, x, y)[0] == BLUE_CAR
    row = Picker().find_row_at(document, snapshot, x, y)
    assert document.scene.instance_ids[row] == BLUE_CAR
    assert Picker().find_row_at(document, snapshot, 240.0, 10.0) is None, "the sky"


def test_a_solid_thing_before_a_car_wins_and_the_car_is_behind_it():
    document, where = with_floater(opacity=0.97, size=0.12)
    below = Picker().find_instances_at(document, take_snapshot(document), *find_pixel(document, where))
    assert below[:2] == (FLOATER, BLUE_CAR)


def test_hidden_and_deleted_splats_cannot_be_clicked(street):
    place, picker, snapshot = find_pixel(street, (3.4, 5.8, 0.8)), Picker(), take_snapshot(street)
    assert picker.find_instances_at(street, snapshot, *place)[0] == BLUE_CAR
    street.apply(HideInstances((BLUE_CAR,)))
    assert BLUE_CAR not in picker.find_instances_at(street, snapshot, *place)
    street.undo()
    assert picker.find_instances_at(street, snapshot, *place)[0] == BLUE_CAR
    street.apply(DeleteInstances((BLUE_CAR,)))
    assert BLUE_CAR not in picker.find_instances_at(street, snapshot, *place)


def test_sky_and_places_outside_the_picture_hold_nothing(street):
    picker, snapshot = Picker(), take_snapshot(street)
    for place in ((240.0, 10.0), (-1.0, 5.0), (5.0, 270.0), (480.0, 100.0)):
        assert picker.find_instances_at(street, snapshot, *place) == ()


EDITS = [
    MoveInstances((BLUE_CAR,), (-1.0, 1.5, 0.2), rotation=(0.9, 0.0, 0.0, 0.4), scale=1.2),
    MoveInstances((DRIVING_CAR,), (-1.5, -3.0, 0.0), rotation=(0.9, 0.0, 0.0, 0.2), scale=1.1),
    DuplicateInstances((BLUE_CAR, DRIVING_CAR), (1.0, 3.0, 0.0)),
    AdjustInstances((BLUE_CAR,), "opacity", 0.5),
    DeleteInstances((FIRST_CAR,)),
    MergeInstances((HOUSES,), HOUSES + 3),
    DuplicateInstances((HOUSES + 3, ROAD), (1.0, 1.0, 0.5)),
]


def test_clicks_follow_every_edit_as_if_asked_for_the_first_time_and_as_baked(street):
    state = EditorState(viewpoint=camera.view_from_camera(street.scene.views[2]))
    picker, rng = Picker(), np.random.default_rng(3)
    places = np.stack([rng.integers(0, SIZE[0], 60), rng.integers(SIZE[1] // 3, SIZE[1], 60)], axis=1).tolist()

    def answers(of, document):
        return [of.find_instances_at(document, resolve(state, *SIZE), x, y) for x, y in places]

    seen = [answers(picker, street)]
    for edit in deepcopy(EDITS):
        street.apply(edit)
        state.time = 0.5 * (state.time == 0)
        found = answers(picker, street)
        assert found == answers(Picker(), street)
        bare = answers(Picker(), Document(bake_document(street, state.time)))
        assert [below[:1] for below in found] == [below[:1] for below in bare]
        seen.append(found)
    assert sum(before != after for before, after in pairwise(seen)) >= len(EDITS) - 1, "edits are seen by clicks"
    while street.undo():
        assert answers(picker, street) == answers(Picker(), street)
    state.time = 0.0
    assert answers(picker, street) == seen[0]


def test_two_pickers_and_a_view_follow_one_document(gl, street):
    renderer, first, second = GlRenderer(gl, street), Picker(), Picker()
    snapshot, place = take_snapshot(street), find_pixel(street, (3.4, 5.8, 0.8))
    for _ in range(2):
        assert first.find_instances_at(street, snapshot, *place)[0] == BLUE_CAR
        assert renderer.read_instance_ids(snapshot)[int(place[1]), int(place[0])] == BLUE_CAR
        street.apply(DeleteInstances((BLUE_CAR,)))
        assert BLUE_CAR not in renderer.read_instance_ids(snapshot)
        assert BLUE_CAR not in first.find_instances_at(street, snapshot, *place)
        assert BLUE_CAR not in second.find_instances_at(street, snapshot, *place)
        street.undo()
    renderer.release()


@pytest.fixture
def tool(street):
    session = EditorSession()
    session.show(street)
    yield PickTool(session), session
    session.close()


def test_clicking_again_takes_the_one_behind_and_comes_around(tool, street):
    tool, session = tool
    snapshot, (x, y) = take_snapshot(street), find_pixel(street, (3.4, 5.8, 0.8))
    below = Picker().find_instances_at(street, snapshot, x, y)
    assert below[0] == BLUE_CAR
    assert len(below) >= 2
    for turn in range(len(below) + 1):
        assert tool.click(Click(x, y), snapshot) == below[turn % len(below)]
        assert session.selection.ids == (below[turn % len(below)],)
    assert tool.click(Click(x - 20, y), snapshot) == BLUE_CAR, "elsewhere it begins anew"
    tool.click(Click(x, y), snapshot)
    assert tool.click(Click(x, y), take_snapshot(street, 2)) == street_at(street, 2, x, y), "so does another viewpoint"


def test_clicking_again_takes_what_a_solid_thing_hides(tool, street):
    tool, session = tool
    snapshot, (x, y) = take_snapshot(street), find_pixel(street, (3.4, 5.8, 0.8))
    street.scene.gaussians.opacity_logits[street.find_rows((BLUE_CAR,))] = 8.0  # nothing shines through
    street.scene.gaussians.log_scales[street.find_rows((BLUE_CAR,))] += 0.7
    below = Picker().find_below(street, snapshot, x, y)
    assert below.seen == (BLUE_CAR,)
    assert below.hidden
    assert tool.click(Click(x, y), snapshot) == BLUE_CAR
    assert tool.click(Click(x, y), snapshot) == below.hidden[0]
    alone = Document(bake_document(street, 0.0))
    alone.apply(HideInstances((BLUE_CAR,)))
    assert below.hidden[0] == Picker().find_instances_at(alone, snapshot, x, y)[0], (
        "the one that would be seen without it"
    )
    session.visibility.lock((BLUE_CAR,))
    tool.hover(x, y, snapshot)
    assert session.state.hovered == 0, "a locked thing hides what is behind it: a click takes nothing unseen"


def street_at(document, index, x, y):
    return Picker().find_instances_at(document, take_snapshot(document, index), x, y)[0]


def test_modifiers(tool, street):
    tool, session = tool
    snapshot = take_snapshot(street)
    blue, red = find_pixel(street, (3.4, 5.8, 0.8)), find_pixel(street, (-2.1, 4.6, 0.8))
    road = find_pixel(street, (0.0, 6.0, 0.0))
    tool.click(Click(*blue), snapshot)
    tool.click(Click(*road, shift=True), snapshot)
    assert session.selection.ids == (ROAD, BLUE_CAR)
    tool.click(Click(*road, ctrl=True), snapshot)
    assert session.selection.ids == (BLUE_CAR,)
    tool.click(Click(*red, alt=True), snapshot)
    assert session.selection.ids == (FIRST_CAR, BLUE_CAR)
    tool.click(Click(240.0, 10.0, shift=True), snapshot)
    assert session.selection.ids == (FIRST_CAR, BLUE_CAR), "Shift on nothing keeps the selection"
    tool.click(Click(240.0, 10.0), snapshot)
    assert session.selection.ids == ()


def test_alt_selects_the_instance_where_the_scene_has_no_codewords(tool, street):
    tool, session = tool
    street.scene.code_bits = 0
    tool.click(Click(*find_pixel(street, (3.4, 5.8, 0.8)), alt=True), take_snapshot(street))
    assert session.selection.ids == (BLUE_CAR,)


def test_hovering_names_the_instance_without_selecting_it(tool, street):
    tool, session = tool
    tool.hover(*find_pixel(street, (3.4, 5.8, 0.8)), take_snapshot(street))
    assert (session.state.hovered, session.selection.ids) == (BLUE_CAR, ())
    tool.hover(10.0, 40.0, take_snapshot(street))
    assert session.state.hovered in (HOUSES, 30)
    tool.leave()
    assert session.state.hovered == 0


def test_what_is_locked_is_clicked_through(tool, street):
    tool, session = tool
    snapshot, (x, y) = take_snapshot(street), find_pixel(street, (3.4, 5.8, 0.8))
    behind = Picker().find_instances_at(street, snapshot, x, y)[1]
    session.visibility.lock((BLUE_CAR,))
    tool.hover(x, y, snapshot)
    assert session.state.hovered == behind
    assert tool.click(Click(x, y), snapshot) == behind
    assert session.selection.ids == (behind,)
