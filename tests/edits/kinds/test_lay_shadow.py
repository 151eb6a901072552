"""Shadows that are laid darken the ground below a thing, go where it goes, and vanish with undo."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from document_snapshot import snapshot
from parked_street import CAR, CAR_CENTER, CAR_SIZE, OTHER_CAR, PAVEMENT, WALL, parked_street
from procedural_street import DRIVING_CAR, FIRST_CAR, procedural_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.holes.shade import SceneLight
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.driving.ways import change_way, drive_instance
from instdrive_core.edits.kinds.light.cast_shadows import find_put, measure_move, plan_shadows
from instdrive_core.edits.kinds.light.lay_shadow import LayShadow, find_shadowed
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.reset_moves import ResetMoves
from instdrive_core.edits.queries.bake import bake_document, recount_table
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import EditError
from instdrive_core.instances.shadows import LEARNED_SHADOW
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import concatenate_gaussians
from instdrive_core.scene.selection import Flag

AWAY = (-3.5, 0.0, 0.0)
"""Onto the free lane."""
PLACE = CAR_CENTER + AWAY


@pytest.fixture(scope="module")
def street():
    return parked_street()


@pytest.fixture
def moved(street):
    """The street with its car on the free lane, without a shadow."""
    document = Document(deepcopy(street.scene))
    document.apply(MoveInstances((CAR,), AWAY))
    return document


def brightness(document, place, half=0.1):
    """Mean brightness of a spot of the ground seen from straight above, with the car out of the way."""
    bare = deepcopy(document)
    rows = bare.find_rows((CAR,))
    body = rows[bare.scene.extra["synthetic"][rows] == 0] if "synthetic" in bare.scene.extra else rows
    bare.state.change(body, Flag.DELETED, True)
    x, y = place
    pose = look_at(np.array([x, y, 8.0]), np.array([x, y + 0.01, 0.0]))
    camera = Camera(400.0, 400.0, 32.0, 32.0, 64, 64, pose)
    return float(view_scene(bake_document(bare), camera, 0.0).color[24:40, 24:40].mean())


def test_the_ground_below_is_dark_and_the_ground_beside_is_not(moved):
    bare = {offset: brightness(moved, (PLACE[0] + offset, PLACE[1])) for offset in (0.0, 2.2)}
    moved.apply(LayShadow(CAR, contact=0.6))
    laid = {offset: brightness(moved, (PLACE[0] + offset, PLACE[1])) for offset in bare}
    assert laid[0.0] == pytest.approx(0.4 * bare[0.0], rel=0.12)
    assert laid[2.2] == pytest.approx(bare[2.2], rel=0.02)


def test_a_sun_throws_it_to_one_side(moved):
    spots = {side: (PLACE[0] + side * 1.4, PLACE[1]) for side in (-1, 1)}
    bare = {side: brightness(moved, spot) for side, spot in spots.items()}
    moved.apply(LayShadow(CAR, contact=0.3, sun=(-0.8, 0.0), sun_share=0.5))
    laid = {side: brightness(moved, spot) for side, spot in spots.items()}
    assert laid[-1] < 0.65 * bare[-1]
    assert laid[1] > 0.85 * bare[1]


def test_it_is_part_of_the_thing_but_neither_its_body_nor_what_a_pixel_shows(moved):
    before = build_map(moved)
    centre, count = moved.scene.table[CAR].bounds, moved.scene.table[CAR].count
    moved.apply(LayShadow(CAR))
    assert moved.scene.table[CAR].count > count
    np.testing.assert_allclose(moved.scene.table[CAR].bounds, centre, atol=0.15)
    differs = build_map(moved) != before
    assert differs.mean() < 0.002


def build_map(document):
    scene = bake_document(document)
    pose = look_at(PLACE + np.array([-1.0, -9.0, 2.0]), PLACE)
    camera = Camera(260.0, 260.0, 160.0, 100.0, 320, 200, pose)
    return build_instance_map(scene, view_scene(scene, camera, 0.0))


def test_it_goes_with_the_thing_and_back(moved):
    moved.apply(LayShadow(CAR))
    rows = shadow_rows(moved)
    assert np.abs(moved.compute_means(rows)[:, :2].mean(axis=0) - PLACE[:2]).max() < 0.15
    moved.apply(MoveInstances((CAR,), (0.0, 2.0, 0.0)))
    assert moved.compute_means(rows)[:, 1].mean() == pytest.approx(PLACE[1] + 2, abs=0.15)
    moved.apply(ResetMoves((CAR,)))
    assert np.abs(moved.compute_means(rows)[:, :2].mean(axis=0) - CAR_CENTER[:2]).max() < 0.15
    moved.apply(DeleteInstances((CAR,)))
    assert (moved.state.flags[rows] & Flag.DELETED).all()
    assert find_shadowed(moved) == set()


def shadow_rows(document):
    return np.flatnonzero(document.scene.extra["synthetic"] == 2)


def test_a_new_one_takes_the_place_of_the_old_one(moved):
    moved.apply(LayShadow(CAR))
    first = shadow_rows(moved)
    moved.apply(MoveInstances((CAR,), (0.0, 3.0, 0.0)))
    moved.apply(LayShadow(CAR))
    assert (moved.state.flags[first] & Flag.DELETED).all()
    left = np.setdiff1d(shadow_rows(moved), first)
    assert not (moved.state.flags[left] & Flag.DELETED).any()
    assert find_shadowed(moved) == {CAR}
    moved.undo()
    assert not (moved.state.flags[first] & Flag.DELETED).any()
    np.testing.assert_array_equal(shadow_rows(moved), first)


def test_it_fits_a_turned_and_scaled_thing(moved):
    moved.apply(MoveInstances((CAR,), rotation=(0.8, 0.0, 0.0, 0.6), scale=0.5, pivot=tuple(PLACE), on_ground=True))
    moved.apply(LayShadow(CAR))
    means = moved.compute_means(shadow_rows(moved))
    ground = 0.02 * means[:, 1]
    assert np.abs(means[:, 2] - ground).max() < 0.1
    assert np.ptp(means[:, :2], axis=0).max() < CAR_SIZE[1] * 0.5 + 2.5
    scene = bake_document(moved)
    scales = np.exp(scene.gaussians.log_scales[scene.extra["synthetic"] == 2])
    np.testing.assert_allclose(np.median(scales, axis=0), [0.3, 0.3, 0.005], rtol=1e-3)


def test_colours_leave_it_black(moved):
    moved.apply(LayShadow(CAR))
    rows = shadow_rows(moved)
    moved.apply(RecolorInstances((CAR,), "solid", (0.9, 0.1, 0.1)))
    assert not moved.colors.indices[rows].any()
    assert moved.colors.indices[np.setdiff1d(moved.find_rows((CAR,)), rows)].all()


def test_undo_and_redo_give_every_bit_again(moved):
    before = snapshot(moved)
    moved.apply(LayShadow(CAR, sun=(0.5, 0.2), sun_share=0.4))
    after = snapshot(moved)
    moved.undo()
    assert snapshot(moved) == before
    assert "synthetic" not in moved.scene.extra
    moved.redo()
    assert snapshot(moved) == after


def test_files_keep_all_of_it():
    edit = LayShadow(CAR, 0.5, (0.4, -0.1), 0.3, 0.25, 1.5)
    assert edit_from_json(edit.to_json()) == edit


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda: LayShadow(0), "id 0 is not a positive whole number"),
        (lambda: LayShadow(CAR, contact=0.9), "contact 0.9 is not 0 to 0.85"),
        (lambda: LayShadow(CAR, sun_share=-0.1), "sun_share -0.1 is not 0 to 0.85"),
        (lambda: LayShadow(CAR, sun=(8.0, 8.0)), "longer than 10 m for each metre"),
        (lambda: LayShadow(CAR, softness=0.0), "softness 0.0 is not 0.01 to 2 metres"),
    ],
)
def test_what_cannot_be_is_refused(edit, message):
    with pytest.raises(EditError, match=message):
        edit()


def test_what_has_none_is_told(moved):
    with pytest.raises(EditError, match="there is no instance 99"):
        moved.apply(LayShadow(99))
    moved.apply(MoveInstances((CAR,), (0.0, 0.0, 2.0)))
    before = snapshot(moved)
    with pytest.raises(EditError, match="does not stand on the ground"):
        moved.apply(LayShadow(CAR))
    moved.apply(DeleteInstances((OTHER_CAR,)))
    with pytest.raises(EditError, match="nothing is left of instance 8"):
        moved.apply(LayShadow(OTHER_CAR))
    moved.undo()
    assert snapshot(moved) == before
    for surface in (PAVEMENT, WALL):
        assert surface in moved.scene.table


def test_what_leaves_its_way_later_gets_one_and_what_stays_gets_none():
    document = Document(procedural_street())
    track = document.scene.actors[document.scene.table[DRIVING_CAR].node - 1]
    start = float(track.times[0])
    edit = drive_instance(document.scene.table[DRIVING_CAR], change_way(track, "lane", 3.0, start))
    document.apply(edit)
    assert measure_move(document, DRIVING_CAR) > 0.5
    (laid,) = plan_shadows(freeze_document(document), find_put(edit), SceneLight(), start)
    assert laid == LayShadow(DRIVING_CAR, softness=0.2, time=start)
    move = MoveInstances((FIRST_CAR,), (0.1, 0.0, 0.0))
    document.apply(move)
    assert plan_shadows(freeze_document(document), find_put(move), SceneLight(), start) == ()


@pytest.fixture
def passing():
    """A street whose driving car has learned its shadow."""
    scene = procedural_street()
    rows = np.flatnonzero(scene.instance_ids == DRIVING_CAR)
    shadow = scene.gaussians.select(rows[:60])
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    foot = float(scene.gaussians.means[rows, 2].min())
    shadow.means[:] = np.c_[3 * np.cos(angles), 4 * np.sin(angles), np.full(60, foot)]
    shadow.sh_dc[:] = dc_from_color(np.zeros(3))
    shadow.opacity_logits[:] = -1.0
    gaussians = concatenate_gaussians([scene.gaussians, shadow])
    marks = np.zeros(len(gaussians), np.uint8)
    marks[-60:] = LEARNED_SHADOW
    added = [np.full(60, value, kind) for value, kind in ((DRIVING_CAR, np.uint32), (50, np.uint32), (1, np.uint16))]
    columns = (scene.instance_ids, scene.codewords, scene.nodes)
    ids, words, nodes = (np.concatenate(pair) for pair in zip(columns, added, strict=True))
    changed = replace(
        scene, gaussians=gaussians, instance_ids=ids, codewords=words, nodes=nodes, extra={"synthetic": marks}
    )
    return Document(recount_table(changed))


def test_what_has_learned_its_shadow_takes_it_along_and_gets_no_other(passing):
    entry = passing.scene.table[DRIVING_CAR]
    track = passing.scene.actors[entry.node - 1]
    start = float(track.times[0])
    edit = drive_instance(entry, change_way(track, "lane", 3.0, start))
    passing.apply(edit)
    assert plan_shadows(freeze_document(passing), find_put(edit), SceneLight(), start) == ()
    assert find_shadowed(passing) == set()
    faint = passing.scene.extra["synthetic"] == LEARNED_SHADOW
    passing.scene.gaussians.opacity_logits[faint] = -6.0  # photos showed none
    assert len(plan_shadows(freeze_document(passing), find_put(edit), SceneLight(), start)) == 1


def test_a_learned_shadow_is_none_of_the_body(passing):
    plain = Document(procedural_street())
    assert passing.scene.table[DRIVING_CAR].bounds == plain.scene.table[DRIVING_CAR].bounds
    before = snapshot(passing)
    passing.apply(RecolorInstances((DRIVING_CAR,), "solid", (1.0, 0.0, 0.0)))
    np.testing.assert_allclose(color_from_dc(passing.scene.gaussians.sh_dc[-60:]), 0, atol=1e-6)
    passing.undo()
    move = MoveInstances((DRIVING_CAR,), AWAY)
    passing.apply(move)
    bounds = np.array(passing.scene.table[DRIVING_CAR].bounds)
    plain.apply(MoveInstances((DRIVING_CAR,), AWAY))
    np.testing.assert_allclose(bounds, plain.scene.table[DRIVING_CAR].bounds, atol=1e-5)
    passing.undo()
    passing.apply(DeleteInstances((DRIVING_CAR,)))
    assert (passing.state.flags[-60:] & Flag.DELETED).all()
    passing.undo()
    assert snapshot(passing) == before
