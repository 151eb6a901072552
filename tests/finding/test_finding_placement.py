"""Where a scene lies among photos: turned, scaled, without its origin, or by the cameras that it knows."""

from dataclasses import replace

import numpy as np
import pytest
from drive import drive
from photographed_street import write_photographed_street
from procedural_street import procedural_street

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError
from instdrive_core.finding.photo_likeness import choose_placement, measure_likeness
from instdrive_core.finding.placement import align_cameras, list_placements, place_scene
from instdrive_core.formats.registry import open_scene
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.pose_transforms import transform_view

TURN = np.c_[2.5 * matrix_from_quaternion(np.array([0.8, 0.2, -0.5, 0.3]) / np.sqrt(1.02)), [3.0, -4.0, 0.5]]


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    return write_photographed_street(tmp_path_factory.mktemp("street"), with_masks=False)


@pytest.fixture(scope="module")
def clip(street):
    return load_clip(str(street.photos), ClipOptions())


def test_a_scene_in_the_world_of_the_photos_files_is_found_and_no_other(street, clip):
    scene = open_scene(street.scene)
    places = list_placements(scene, clip, np.eye(3, 4))
    assert len(places) > 1
    matrix, match = choose_placement(scene, clip, places, "street.ply")
    right = measure_likeness(place_scene(scene, matrix, clip.origin), clip.training_frames[:3])
    assert right.fits
    assert min(right.likeness, match.likeness) > 0.8
    for other in places:
        if other is not matrix:
            assert not measure_likeness(place_scene(scene, other, clip.origin), clip.training_frames[:3]).fits


def test_turns_of_the_user_count(street, clip):
    """The scene's file is askew, and only the user's edit has it upright among the photos."""
    scene = open_scene(street.scene)
    upright = np.c_[clip.world_from_file[:, :3], -clip.origin]
    askew = place_scene(scene, np.linalg.inv(np.r_[TURN, [[0, 0, 0, 1]]])[:3], scene.origin)
    back = np.r_[upright, [[0, 0, 0, 1]]] @ np.r_[TURN, [[0, 0, 0, 1]]]
    with pytest.raises(DataError, match="in the same world: origin, axes and unit"):
        choose_placement(askew, clip, list_placements(askew, clip, np.eye(3, 4)), "askew.ply")
    places = list_placements(askew, clip, back[:3])
    np.testing.assert_allclose(choose_placement(askew, clip, places, "askew.ply")[0], back[:3], atol=1e-6)


def test_cameras_of_the_same_photos_tell_the_place():
    views = tuple(
        replace(view, photo=f"images/{number:03d}.jpg") for number, view in enumerate(procedural_street(1.0).views)
    )
    moved = tuple(transform_view(view, TURN) for view in views)
    np.testing.assert_allclose(align_cameras(views, moved[::-1]), TURN, atol=1e-9)
    assert align_cameras(views[:1], moved) is None
    assert align_cameras(tuple(replace(view, photo="") for view in views), moved) is None
    assert align_cameras(tuple(replace(view, photo="same.jpg") for view in views), moved) is None


def test_actors_and_views_go_along():
    scene = procedural_street(1.0)
    placed = place_scene(scene, TURN, np.array([1.0, 2.0, 3.0]))
    driving = scene.nodes > 0
    np.testing.assert_array_equal(placed.origin, [1, 2, 3])
    np.testing.assert_allclose(placed.gaussians.means[driving], 2.5 * scene.gaussians.means[driving], rtol=1e-5)
    still = scene.gaussians.means[~driving] @ TURN[:, :3].T + TURN[:, 3]
    np.testing.assert_allclose(placed.gaussians.means[~driving], still, atol=1e-4)
    np.testing.assert_allclose(placed.actors[0].dimensions, 2.5 * scene.actors[0].dimensions)
    before, after = scene.views[0].camera, placed.views[0].camera
    point = np.array([[0.5, 12.0, 1.0]])
    moved = point @ TURN[:, :3].T + TURN[:, 3]
    np.testing.assert_allclose(after.project(moved)[0], before.project(point)[0], atol=1e-6)
    assert scene.origin.any() == np.zeros(3).any()


def test_photos_that_see_nothing_of_the_scene_are_named():
    clip = drive()
    scene = procedural_street(1.0)
    scene.gaussians.means[:, 2] += 5000
    with pytest.raises(DataError, match=r"hardly any of the scene far\.ply lies before its cameras"):
        choose_placement(scene, clip, [np.eye(3, 4)], "far.ply")
