"""A car of which one side was seen becomes whole; what is whole or lopsided is told."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from document_snapshot import snapshot
from half_seen_car import CAR, PLACE, TURN, car_surface, half_seen_car, scene_of
from scipy.spatial import KDTree

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.fingerprint import fingerprint
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.delete import DeleteSelected
from instdrive_core.edits.kinds.light.cast_shadows import Put, find_put
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.kinds.shape.complete import CompleteInstance, make_completion, mirror_gaussians
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.queries.symmetry import Symmetry, find_seen_side, find_symmetry
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import EditError
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.maths.spherical_harmonics import color_from_dc, evaluate_view_colors
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.selection import Flag


@pytest.fixture(scope="module")
def car():
    return half_seen_car()


@pytest.fixture
def document(car):
    return Document(deepcopy(car))


def test_the_plane_goes_through_the_middle_along_the_car(document):
    edit = make_completion(document, CAR)
    plane = Symmetry(edit.place, edit.heading, 1.0)
    assert abs(plane.measure(np.array([[*PLACE, 0.0]]))[0]) < 0.06
    assert abs(np.sin(edit.heading - TURN)) < np.radians(2)
    right = np.array([[*(PLACE + 0.9 * np.array([np.sin(TURN), -np.cos(TURN)])), 0.7]])
    assert edit.side * plane.measure(right)[0] > 0, "the seen side is the right one"


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("seen", [-1, 1])
def test_the_far_side_is_there_afterwards_and_its_haze_is_gone(seed, seen):
    document = Document(half_seen_car(seed, seen))
    whole, _ = car_surface(np.random.default_rng(seed + 100), 4000)
    far = whole[whole[:, 1] * seen < -0.85]
    axes = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])
    far[:, :2] = far[:, :2] @ axes + PLACE
    before, _ = alive_tree(document).query(far)
    document.apply(make_completion(document, CAR))
    after, _ = alive_tree(document).query(far)
    assert np.quantile(after, 0.95) < 0.2
    assert np.quantile(before, 0.95) > 0.25
    shown = document.scene.gaussians.sh_dc[alive(document)]
    assert (shown[:, 2] - shown[:, 0]).max() < 0.5, "no blue haze is left"


def alive(document):
    return np.flatnonzero((document.state.flags & Flag.DELETED) == 0)


def alive_tree(document):
    return KDTree(document.compute_means(alive(document)))


def test_what_was_prepared_on_a_copy_is_what_is_done_unless_the_document_was_edited(document, monkeypatch):
    edit, plain = make_completion(document, CAR), Document(deepcopy(document.scene))
    plain.apply(make_completion(plain, CAR))
    edit.prepare(freeze_document(document))
    with monkeypatch.context() as patched:
        patched.setattr(CompleteInstance, "_mirror", lambda *_: pytest.fail("it was prepared"))
        document.apply(edit)
        assert fingerprint(document) == fingerprint(plain)
        document.undo()
        document.redo()
        assert fingerprint(document) == fingerprint(plain)
    for each in (document, plain):  # without a part of what was mirrored
        each.undo()
        each.apply(SelectRows(each.find_rows((CAR,))[::3]))
        each.apply(DeleteSelected())
    document.apply(edit)
    plain.apply(replace(edit))
    assert fingerprint(document) == fingerprint(plain)


def test_it_is_marked_selected_and_undone(document):
    document.apply(SelectInstances((CAR,)))
    before = snapshot(document)
    document.apply(make_completion(document, CAR))
    after = snapshot(document)
    column = document.scene.extra["synthetic"]
    assert set(np.unique(column).tolist()) == {0, 3}
    assert (document.state.flags[column == 3] == Flag.SELECTED).all()
    document.undo()
    assert snapshot(document) == before
    document.redo()
    assert snapshot(document) == after


def test_a_completed_car_is_the_car_that_was_there(document):
    edit = make_completion(document, CAR)
    document.apply(edit)
    assert edit.added_ids == ()
    assert find_put(edit) == Put((CAR,), frozenset()), "where it has always stood, photos show its shadow"


def test_a_moved_and_scaled_car_is_completed_where_it_stands(document):
    document.apply(MoveInstances((CAR,), (3.0, 1.0, 0.0), (0.9, 0.1, 0.0, 0.3), 1.4))
    edit = make_completion(document, CAR)
    document.apply(edit)
    rows = alive(document)
    points = document.compute_means(rows).astype(float)
    apart, _ = KDTree(points).query(Symmetry(edit.place, edit.heading, 1.0).mirror(points))
    assert np.quantile(apart, 0.99) < 0.01


def test_ellipsoids_and_what_shows_along_each_direction_are_mirrored(car):
    plane, move = Symmetry((1.0, 2.0), 0.4, 1.0), np.c_[np.eye(3), np.zeros(3)]
    one = car.gaussians.select(np.arange(50))
    twin = mirror_gaussians(one, plane, move)
    flip = np.eye(3) - 2 * np.outer([*plane.normal, 0], [*plane.normal, 0])

    def covariances(gaussians):
        axes = matrix_from_quaternion(gaussians.quats.astype(float)) * np.exp(gaussians.log_scales)[:, None]
        return axes @ axes.transpose(0, 2, 1)

    np.testing.assert_allclose(covariances(twin), flip @ covariances(one) @ flip, atol=1e-6)
    np.testing.assert_allclose(plane.mirror(twin.means.astype(float)), one.means, atol=1e-5)
    directions = np.tile([0.6, -0.48, 0.64], (50, 1)).astype(np.float32)
    np.testing.assert_allclose(
        evaluate_view_colors(twin.sh_dc, twin.sh_rest, directions @ flip.astype(np.float32)),
        evaluate_view_colors(one.sh_dc, one.sh_rest, directions),
        atol=1e-5,
    )


def test_a_car_that_was_seen_from_both_sides_is_left_alone():
    rng = np.random.default_rng(0)
    points, colors = car_surface(rng, 5000)
    plane = find_symmetry(points, colors)
    assert find_seen_side(plane, points) == 0
    document = Document(scene_of(rng, points, colors, np.full(len(points), CAR, np.uint32)))
    with pytest.raises(EditError, match="both sides of Car 3 were seen"):
        make_completion(document, CAR)


@pytest.mark.parametrize("seen", [-1, 1])
def test_strays_beside_a_car_do_not_say_which_side_was_seen(seen):
    scene = half_seen_car(0, seen)
    side = make_completion(Document(deepcopy(scene)), CAR).side
    across = np.array([-np.sin(TURN), np.cos(TURN)])
    rng = np.random.default_rng(4)
    strays = rng.uniform(-0.5, 0.5, (150, 3)) + np.array([*(PLACE - 6 * seen * across), 1.0])
    colors = np.concatenate([color_from_dc(scene.gaussians.sh_dc), np.tile([0.4, 0.4, 0.4], (150, 1))])
    means = np.concatenate([scene.gaussians.means, strays])
    document = Document(scene_of(rng, means, colors, np.full(len(means), CAR, np.uint32)))
    assert make_completion(document, CAR).side == side


def test_what_was_hidden_from_both_sides_is_closed_in_the_colours_around():
    """The bonnet behind another car: nothing of it was seen, and the ground shows through."""
    car = half_seen_car()
    axes = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])
    x, y = ((car.gaussians.means[:, :2] - PLACE) @ axes.T).T
    hidden = (x > 0.8) & (x < 1.8) & (np.abs(y) < 0.7)
    rng, left = np.random.default_rng(5), np.flatnonzero(~hidden)
    means, colors = car.gaussians.means[left], color_from_dc(car.gaussians.sh_dc[left])
    scene = scene_of(rng, means, colors, np.full(len(left), CAR, np.uint32))
    bonnet = np.array([*(np.array([1.3, 0.0]) @ axes + PLACE), 1.2])
    above = Camera(100, 100, 8, 8, 16, 16, look_at(bonnet + np.array([0.01, 0.0, 3.0]), bonnet))
    assert view_scene(scene, above, 0.0).alpha.mean() < 0.5
    document = Document(scene)
    edit = make_completion(document, CAR)
    document.apply(edit_from_json(edit.to_json()))
    closed = view_scene(bake_document(document), above, 0.0)
    assert closed.alpha.min() > 0.9
    np.testing.assert_allclose(closed.color.mean(axis=(0, 1)), [0.7, 0.1, 0.1], atol=0.1)
    document.undo()
    document.apply(replace(edit, inset=0.0))  # as projects from before have it
    assert view_scene(bake_document(document), above, 0.0).alpha.mean() < 0.5


def test_what_is_lopsided_small_or_unknown_is_told(car):
    rng = np.random.default_rng(0)
    heap = rng.uniform(0, 1, (900, 3)) ** [1, 3, 2] * [4, 2, 1.5]
    document = Document(scene_of(rng, heap, rng.random((900, 3)), np.full(900, CAR, np.uint32)))
    with pytest.raises(EditError, match="Car 3 does not look symmetric"):
        make_completion(document, CAR)
    few = Document(scene_of(rng, heap[:50], rng.random((50, 3)), np.full(50, CAR, np.uint32)))
    with pytest.raises(EditError, match="too few splats"):
        make_completion(few, CAR)
    with pytest.raises(EditError, match="there is no instance 99"):
        make_completion(document, 99)
    with pytest.raises(EditError, match="nothing on that side"):
        document.apply(CompleteInstance(CAR, (0.0, 90.0), 0.0, 1))
    with pytest.raises(EditError, match="side 0 is neither 1 nor -1"):
        CompleteInstance(CAR, side=0)
    with pytest.raises(EditError, match=r"inset -0\.1 is below 0"):
        CompleteInstance(CAR, inset=-0.1)


def test_files_keep_all_of_it():
    edit = CompleteInstance(CAR, (1.5, -2.25), 0.5, -1)
    assert edit_from_json(edit.to_json()) == edit


def photographed_car():
    """The half seen car on ground, a shadow of its own before it, and cameras that show one side and the roof."""
    car, rng = half_seen_car(), np.random.default_rng(3)
    ahead, across = np.array([np.cos(TURN), np.sin(TURN)]), np.array([-np.sin(TURN), np.cos(TURN)])
    shade = rng.uniform(-0.5, 0.5, (200, 2)) @ np.stack([ahead, across]) + PLACE + 2.8 * ahead + 0.5 * across
    floor = rng.uniform(-6, 6, (9000, 2)) + PLACE
    flat = np.concatenate([np.c_[shade, np.full(200, 0.05)], np.c_[floor, np.zeros(9000)]])
    colors = np.repeat([0.05, 0.5], [200, 9000])[:, None].repeat(3, axis=1)
    colors = np.concatenate([color_from_dc(car.gaussians.sh_dc), colors])
    ids = np.r_[np.full(len(car) + 200, CAR), np.zeros(9000)].astype(np.uint32)
    scene = scene_of(rng, np.concatenate([car.gaussians.means, flat]), colors, ids)
    scene.gaussians.log_scales[len(car) :] = np.log([0.15, 0.15, 0.02])
    scene.gaussians.quats[len(car) :] = [1, 0, 0, 0]
    eyes = [PLACE - 7 * across + along * ahead for along in (-3.0, 0.0, 3.0, 5.0)]
    poses = [look_at(np.array([*eye, 3.0]), np.array([*PLACE, 0.6])) for eye in eyes]
    cameras = [Camera(120, 120, 64, 48, 128, 96, pose) for pose in poses]
    return replace(scene, views=tuple(CameraView(camera, "c", 4 * k, 0.0) for k, camera in enumerate(cameras)))


def test_what_photos_show_stays_as_it_is_and_the_far_side_is_filled():
    scene = photographed_car()
    blind = make_completion(Document(replace(deepcopy(scene), views=())), CAR)
    seeing = make_completion(Document(deepcopy(scene)), CAR)
    assert not len(blind.kept)
    assert len(seeing.kept) > 150
    changes, gaps = [], []
    for edit in (blind, seeing, None):
        document = Document(deepcopy(scene))
        if edit is not None:
            document.apply(edit_from_json(edit.to_json()))
        edited = bake_document(document)
        pairs = [(view_scene(each, view.camera, 0.0).color for each in (scene, edited)) for view in scene.views]
        changes.append(np.mean([np.abs(before - after).mean() for before, after in pairs]))
        whole, _ = car_surface(np.random.default_rng(9), 3000)
        far = whole[(whole[:, 1] > 0.85) & (whole[:, 2] < 1.0)]
        axes = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])
        far[:, :2] = far[:, :2] @ axes + PLACE
        gaps.append(np.quantile(KDTree(edited.gaussians.means).query(far)[0], 0.9))
    assert changes[1] < 0.7 * changes[0]
    document = Document(deepcopy(scene))
    document.apply(replace(seeing, gaps=np.arange(10**6)))  # more than there are: a project that was carried over
    assert (document.scene.extra["synthetic"] == 3).sum() < len(scene)
    assert gaps[1] < 0.6 * gaps[2]
