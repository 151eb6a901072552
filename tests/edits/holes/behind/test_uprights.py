"""What stands narrow behind a deleted car, whose photos showed only its upper part, goes on down to the ground."""

import numpy as np
import pytest
from parked_street import CAR, CAR_CENTER, KERB, PAVEMENT, parked_street, scene_of

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.behind.uprights import continue_uprights
from instdrive_core.edits.holes.photo_evidence import Look
from instdrive_core.edits.holes.surroundings import find_neighborhood
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import compute_current_means

POLE, PLACE = 9, np.array([3.4, 0.3])
HANGS = 1.2
"""Metres above the road's height at which what photos showed of the pole begins."""
FOOT = 0.02 * PLACE[1] + KERB


def make_street(bottom=HANGS, top=3.5, width=0.0, flare=0.0, beside=0.0):
    """The parked street with a pole behind the car, whose splats begin `bottom` metres up, on a wall `beside` it. Its
    `width` grows by the `flare` for each metre of height."""
    rng, scene = np.random.default_rng(2), parked_street().scene
    heights = np.arange(bottom, top, 0.02)
    widths = width + flare * (heights - bottom)
    pole = np.c_[
        np.tile(PLACE, (len(heights), 1)) + rng.uniform(-0.5, 0.5, (len(heights), 2)) * widths[:, None], heights
    ]
    parts, ids = [scene.gaussians.means, pole], [scene.instance_ids, np.full(len(pole), POLE)]
    if beside:
        parts.append(pole + np.array([beside, 0, 0]))
        ids.append(np.full(len(pole), PAVEMENT))
    colors = [color_from_dc(scene.gaussians.sh_dc), np.tile([0.1, 0.6, 0.1], (sum(map(len, parts[1:])), 1))]
    return scene_of(rng, np.concatenate(parts), np.concatenate(ids), np.concatenate(colors), scene.views)


def add_support(scene):
    """Another thing in place of what is missing of the pole."""
    pole, low = np.flatnonzero(scene.instance_ids == POLE), HANGS + 1
    upper = pole[scene.gaussians.means[pole, 2] > low]
    scene.instance_ids[upper] = PAVEMENT
    scene.gaussians.means[upper, 2] -= low - FOOT


def make_look(holds):
    """A photo from the street, in which the car hides everything, or nothing."""
    eye = np.array([-4.0, 0.0, 1.8])
    camera = Camera(200.0, 200.0, 200.0, 120.0, 400, 240, look_at(eye, np.array([3.4, 0.0, 0.6])))
    silhouette = np.full((240, 400), holds)
    return Look(camera, 0.0, silhouette, silhouette, 4.0, CAR_CENTER, np.zeros_like(silhouette))


def find_feet(scene, holds=True):
    document = Document(scene)
    document.apply(DeleteInstances((CAR,)))
    near = find_neighborhood(document, CAR_CENTER)
    return continue_uprights(near, (make_look(holds),), lambda places: np.full(len(places), FOOT))


def test_copies_reach_from_the_ground_to_what_was_seen():
    scene = make_street()
    (foot,) = find_feet(scene)
    assert (scene.instance_ids[foot.copied] == POLE).all()
    heights = np.sort(scene.gaussians.means[foot.copied, 2] - foot.drops)
    assert FOOT < heights[0] < FOOT + 0.05
    assert HANGS - 0.05 < heights[-1] < HANGS + 1e-6
    assert np.diff(heights).max() < 0.06, "without a gap"


def test_thin_noise_below_it_is_replaced():
    scene = make_street()
    noise = np.flatnonzero((scene.instance_ids == POLE) & (scene.gaussians.means[:, 2] > HANGS))[::25]
    scene.gaussians.means[noise, 2] -= 0.7
    low = noise[scene.gaussians.means[noise, 2] < HANGS - 0.1]
    assert len(low)
    (foot,) = find_feet(scene)
    np.testing.assert_array_equal(np.intersect1d(foot.replaced, low), low)


@pytest.mark.parametrize(
    ("street", "holds"),
    [
        ({}, False),
        ({"bottom": FOOT + 0.1}, True),
        ({"bottom": 2.4}, True),
        ({"width": 1.4}, True),
        ({"beside": 0.15}, True),
        ({"top": HANGS + 0.5, "width": 0.4}, True),
        ({"width": 0.2, "flare": 1.0}, True),
    ],
    ids=["seen down to the ground", "standing", "out of reach", "wide", "carried by a wall", "a box", "a crown"],
)
def test_what_stands_or_hangs_for_a_reason_stays(street, holds):
    assert find_feet(make_street(**street), holds) == ()


def test_two_poles_of_one_label_are_two():
    scene = make_street()
    other = np.flatnonzero(scene.instance_ids == PAVEMENT)[:120]
    pole = scene.gaussians.means[scene.instance_ids == POLE]
    scene.gaussians.means[other[: len(pole)]] = pole + np.float32([0, 1.5, 0])
    scene.instance_ids[other[: len(pole)]] = POLE
    scene.gaussians.log_scales[other[: len(pole)]] = scene.gaussians.log_scales[scene.instance_ids == POLE][0]
    assert len(find_feet(scene)) == 2


def test_what_stands_on_something_stays():
    scene = make_street()
    assert find_feet(scene)
    add_support(scene)
    assert find_feet(scene) == ()


def test_what_is_locked_stays():
    scene = make_street()
    document = Document(scene)
    document.apply(DeleteInstances((CAR,)))
    document.state.change(document.find_rows((POLE,)), Flag.LOCKED, True)
    near = find_neighborhood(document, CAR_CENTER)
    assert continue_uprights(near, (make_look(True),), lambda places: np.full(len(places), FOOT)) == ()


def fill_behind_the_car(scene, *flags):
    """Delete the car and fill its hole, once the pole has some flags."""
    document = Document(scene)
    document.apply(DeleteInstances((CAR,)))
    for flag in flags:
        document.state.change(document.find_rows((POLE,)), flag, True)
    (edit,) = report_deletion(document, (CAR,), 0.0).make_fill_edits()
    document.apply(edit)
    return document


def test_the_fill_puts_the_pole_on_the_ground_and_undo_takes_it_back():
    scene = make_street()
    count, entry = len(scene), scene.table[POLE]
    document = fill_behind_the_car(scene)
    means, alive = document.scene.gaussians.means, (document.state.flags & Flag.DELETED) == 0
    column = alive & (np.linalg.norm(means[:, :2] - PLACE, axis=1) < 0.1) & (means[:, 2] > FOOT + 0.06)
    assert np.count_nonzero(column[count:]) >= 40
    heights = np.sort(means[column, 2])
    assert heights[0] < FOOT + 0.2
    assert heights[-1] > 3.4
    assert np.diff(heights).max() < 0.15, "without a gap"
    grown = document.scene.table[POLE]
    document.undo()
    assert len(document.scene) == count
    assert document.scene.table[POLE] == entry
    document.redo()
    assert document.scene.table[POLE] == grown


def test_the_foot_is_the_pole_s():
    scene = make_street()
    count = len(scene)
    document = fill_behind_the_car(scene)
    rows = document.find_rows((POLE,))
    foot = rows[rows >= count]
    assert len(foot) >= 40
    assert document.scene.table[POLE].count == len(rows)
    assert POLE not in document.history.done[-1].added_ids, "it only grew"
    assert document.scene.table[POLE].bounds[0][2] < FOOT + 0.3
    assert (document.scene.extra["synthetic"][foot] == 1).all()
    before = document.scene.gaussians.means[foot].copy()
    document.apply(MoveInstances((POLE,), translation=(0.5, 0.0, 0.0)))
    after = compute_current_means(document.scene.gaussians, document.transforms, foot)
    np.testing.assert_allclose(after, before + np.float32([0.5, 0, 0]), atol=1e-5)


@pytest.mark.parametrize("flag", [Flag.SELECTED, Flag.HIDDEN])
def test_the_foot_is_selected_and_hidden_as_the_pole_is(flag):
    scene = make_street()
    count = len(scene)
    document = fill_behind_the_car(scene, flag)
    rows = document.find_rows((POLE,))
    assert (document.state.flags[rows[rows >= count]] == flag).all()
