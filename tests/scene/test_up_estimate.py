"""Guessing which way is up: on the sample scene turned every way, and on files of other programs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.turn_scene import TurnScene
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import find_stated_up, open_scene
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.scene import Scene, scene_from_gaussians
from instdrive_core.scene.up_estimate import estimate_up
from instdrive_core.scene.upright import AXES, compute_axis_direction, compute_upright_rotation

SAMPLE = Path(__file__).parents[2] / "assets/sample_scene"
SPLATS = Path(__file__).parents[3] / "shared/data/splats"
TILTED = [np.array([0.2, -0.9, 0.3]), np.array([-0.5, 0.4, 0.6]), np.array([0.1, 0.2, -1.0])]


@pytest.fixture(scope="module")
def street():
    return open_scene(SAMPLE)


def lying(scene, up):
    """The scene turned so that what was up points along `up`."""
    document = Document(replace(scene))
    w, x, y, z = quaternion_from_matrix(compute_upright_rotation(up).T).tolist()
    document.apply(TurnScene((w, x, y, z)))
    return bake_document(document)


def anonymous(scene):
    """Scene as another program would have it: no cameras, no instances, one moment."""
    return scene_from_gaussians(scene.gaussians.select(scene.nodes == 0))


def degrees(left, right):
    return np.degrees(np.arccos(np.clip(left @ right / np.linalg.norm(left) / np.linalg.norm(right), -1, 1)))


@pytest.mark.parametrize("axis", AXES)
def test_a_street_is_known_by_its_ground_and_by_its_cameras_however_it_lies(street, axis):
    up = compute_axis_direction(axis)
    turned = lying(street, up)
    for scene, reason in ((turned, "the photos' cameras"), (anonymous(turned), "the ground")):
        found = estimate_up(scene)
        assert (found.axis, found.confident, found.reason) == (axis, True, reason)
        np.testing.assert_array_equal(found.direction, up)
        assert found.tilt == 0


@pytest.mark.parametrize("up", TILTED, ids=str)
def test_a_tilt_is_found_within_a_degree(street, up):
    turned = lying(street, up)
    for scene in (turned, anonymous(turned)):
        found = estimate_up(scene)
        assert degrees(found.direction, up) < 1
        assert found.confident
        assert found.tilt > 3


def test_strays_and_broken_splats_do_not_matter(street):
    scene = anonymous(lying(street, compute_axis_direction("+x")))
    gaussians = scene.gaussians.copy()
    gaussians.means[::50] *= 1e6
    gaussians.means[1::50] = np.nan
    gaussians.quats[2::50] = 0
    gaussians.log_scales[3::50] = np.inf
    found = estimate_up(scene_from_gaussians(gaussians))
    assert (found.axis, found.confident) == ("+x", True)


def test_what_has_no_ground_is_no_news_but_for_what_its_format_says():
    blob = scene_from_gaussians(random_scene(count=2000).gaussians)
    assert not estimate_up(blob).confident
    assert estimate_up(blob).axis == "-y", "most files of other programs have the axes of a photo"
    assert estimate_up(random_scene(count=2000, actors=1)).axis == "+z", "cameras that stand upright"
    named = replace(random_scene(count=2000), views=())
    assert (estimate_up(named).axis, estimate_up(named).confident) == ("+z", False), "instances are ours"
    stated = estimate_up(blob, find_stated_up(Path("a.SPZ")))
    assert (stated.axis, stated.confident, stated.reason) == ("-y", True, "the file's format")
    assert find_stated_up(Path("a.ply")) is None


@pytest.mark.parametrize("count", [0, 1, 150])
def test_few_splats_say_nothing(count):
    scene = random_scene(count=max(count, 1)).gaussians.select(slice(0, count))
    assert not estimate_up(scene_from_gaussians(scene)).confident


def test_splats_in_one_place_say_nothing():
    gaussians = random_scene(count=500).gaussians
    gaussians.means[:] = 1
    assert not estimate_up(scene_from_gaussians(gaussians)).confident


def around(up, pitch, count=12):
    """Cameras in a ring, all looking down by `pitch` degrees; the ring lies across `up`."""
    views, rotation = [], compute_upright_rotation(up).T
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False)):
        place = np.array([np.cos(angle), np.sin(angle), np.tan(np.radians(pitch))])
        pose = look_at(place, np.zeros(3))
        pose[:3] = rotation @ pose[:3]
        views.append(CameraView(Camera(50.0, 50.0, 32.0, 24.0, 64, 48, pose), "drone", index, 0.1 * index))
    return tuple(views)


@pytest.mark.parametrize("pitch", [0, 40, 70])
def test_cameras_that_look_down_from_all_sides_still_know_what_is_level(pitch):
    up = np.array([0.3, -0.8, 0.5])
    scene = replace(scene_from_gaussians(random_scene().gaussians), views=around(up, pitch))
    assert degrees(estimate_up(scene).direction, up) < 0.1


def test_cameras_that_disagree_are_not_believed():
    views = around(compute_axis_direction("+z"), 10) + around(compute_axis_direction("-z"), 10)
    scene = replace(scene_from_gaussians(random_scene().gaussians), views=views)
    assert isinstance(scene, Scene)
    assert not estimate_up(scene).confident


@pytest.mark.parametrize(
    ("name", "axis", "reason"),
    [
        ("luma-seal.splat", "-y", "the ground"),
        ("playbot/2_0", "-y", "the ground"),
        ("biker.spz", "-y", "the file's format"),
        ("biker.compressed.ply", None, "custom"),
        ("guitar.compressed.ply", None, "custom"),
        ("fruit_drops_minimal.ply", None, "custom"),
        ("train-1000.ply", None, "custom"),
    ],
)
def test_files_of_other_programs(name, axis, reason):
    """Things without a ground are no news; that their y is down is only the custom."""
    path = SPLATS / name
    if not path.exists():
        pytest.skip("the shared example files are not here")
    found = estimate_up(open_scene(path), find_stated_up(path))
    assert (found.axis, found.confident, found.reason) == (axis or "-y", axis is not None, reason)


def with_haze_below(scene, times, height=15.0):
    """The street, with large faint splats far below it that weigh more than its houses: what no photo saw."""
    gaussians = scene.gaussians
    ground = np.abs(gaussians.means[:, 2]) < 0.3
    haze = gaussians.select(np.tile(np.flatnonzero(ground), times)).copy()
    haze.means[:, 2] -= np.linspace(1.5, height, len(haze)).astype(np.float32)
    haze.log_scales[:] = np.log(0.8)
    haze.opacity_logits[:] = -0.8
    merged = {
        name: np.concatenate([getattr(gaussians, name), getattr(haze, name)])
        for name in ("means", "quats", "log_scales", "opacity_logits", "sh_dc", "sh_rest", "features")
    }
    return scene_from_gaussians(replace(gaussians, **merged))


@pytest.mark.parametrize("axis", AXES)
def test_a_street_over_haze_is_not_turned_over(street, axis):
    """Haze has no weight against what stands on the ground, near it and solid."""
    hazy = with_haze_below(anonymous(street), times=8)
    found = estimate_up(lying(hazy, compute_axis_direction(axis)))
    assert found.axis == axis
    assert found.confident
