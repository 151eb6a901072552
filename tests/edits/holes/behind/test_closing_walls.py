"""Where a thing stood before a wall, the wall is closed in its own colours, not in those of the sky or of noise."""

from dataclasses import replace

import numpy as np
import pytest
from parked_street import WALL, scene_of

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.behind.backdrop import plan_backdrop
from instdrive_core.edits.holes.behind.look_picture import Remains, draw_look
from instdrive_core.edits.holes.behind.seen_through import PhotoDepths
from instdrive_core.edits.holes.photo_evidence import Look
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import color_from_dc, dc_from_color
from instdrive_core.scene.camera import Camera, CameraView, look_at

BRICK, BLUE = np.array([0.6, 0.4, 0.3]), np.array([0.1, 0.2, 0.9])
EYE = np.array([-4.0, 0.0, 1.5])
CAMERA = Camera(100.0, 100.0, 60.0, 40.0, 120, 80, look_at(EYE, EYE + np.array([1, 0, 0])))
PLANE = (-3.0, 0.0, 0.0)
"""Far below."""


def make_wall(thin=0.0, views=()):
    """A wall at x = 6 with a gap of two by two metres, around which half a metre is `thin`."""
    y, z = (each.ravel() for each in np.meshgrid(np.arange(-6, 6, 0.1), np.arange(-2, 6, 0.1)))
    stands = (np.abs(y) > 1) | (np.abs(z - 1.5) > 1)
    y, z = y[stands], z[stands]
    ids, colors = np.full(len(y), WALL), np.tile(BRICK, (len(y), 1))
    scene = scene_of(np.random.default_rng(3), np.c_[np.full(len(y), 6.0), y, z], ids, colors, views)
    around = (np.abs(y) < 1.5) & (np.abs(z - 1.5) < 1.5)
    if thin:
        scene.gaussians.opacity_logits[around] = logit(np.full(around.sum(), thin, np.float32))
    return scene, around


def make_look():
    """A photo in which a car of three by three metres stood before the gap, halfway."""
    silhouette = np.zeros((CAMERA.height, CAMERA.width), bool)
    silhouette[25:55, 45:75] = True
    return Look(CAMERA, 0.0, silhouette, silhouette, 4.0, np.array([0.0, 0.0, 1.5]), np.zeros_like(silhouette))


def no_splats(scene):
    """What fills the ground: none."""
    return scene.gaussians.select(np.zeros(0, np.int64))


def close_wall(scene, seen, hiding=()):
    """The splats that are added, and the wall with them."""
    hiding = np.array(hiding, np.float64).reshape(-1, 3)
    remains = Remains(scene, seen, hiding)
    rng, depths = np.random.default_rng(1), PhotoDepths(Document(scene))
    added = plan_backdrop(remains, no_splats(scene), PLANE, (make_look(),), rng, depths).gaussians
    return added, draw_look(remains, [added], CAMERA, 0.0)


def test_pictures_have_nothing_of_the_sky_that_shines_through_what_is_thin():
    scene, around = make_wall(thin=0.3)
    picture = draw_look(Remains(scene, around, np.zeros((0, 3))), [no_splats(scene)], CAMERA, 0.0)
    thin = (picture.alpha > 0.6) & (picture.alpha < 0.85)
    assert thin.sum() > 100
    np.testing.assert_allclose(picture.color[thin].mean(axis=0), BRICK, atol=0.02)


def test_mixtures_are_not_copied():
    scene, around = make_wall(thin=0.3)
    scene.gaussians.sh_dc[around] = dc_from_color(BLUE[None])
    added, _ = close_wall(scene, around)
    colors = color_from_dc(added.sh_dc)
    inside = np.abs(added.means[:, 1:] - [0, 1.5]).max(axis=1) < 0.8
    assert inside.sum() > 500
    np.testing.assert_allclose(np.median(colors[inside], axis=0), BRICK, atol=0.05)


def test_no_sky_shines_through_around_the_gap():
    scene, _ = make_wall(thin=0.3)
    _, picture = close_wall(scene, np.zeros(len(scene), bool))
    assert picture.alpha[25:55, 45:75].min() > 0.9


@pytest.mark.parametrize("told", [False, True])
def test_what_is_thin_stays_where_photos_told_it(told):
    scene, around = make_wall(thin=0.3)
    scene.gaussians.sh_dc[around] += np.float32([0, 1, 0])  # a door
    added, _ = close_wall(scene, around & told)
    closed = np.abs(added.means[:, 1:] - [0, 1.5]).max(axis=1)
    assert (closed.max() > 1.4) != told


@pytest.mark.parametrize("gone", [False, True])
def test_what_shows_where_another_car_is_gone_is_not_continued(gone):
    scene, _ = make_wall()
    means = scene.gaussians.means
    noise = (means[:, 1] > 1) & (means[:, 1] < 5) & (np.abs(means[:, 2] - 1.5) < 2)
    gaussians = replace(scene.gaussians, sh_dc=scene.gaussians.sh_dc.copy())
    gaussians.sh_dc[noise] += np.float32((BLUE - BRICK) / 0.28209479)
    points = EYE + (means[noise] - EYE) / 2  # the other car stood halfway, too
    added, _ = close_wall(replace(scene, gaussians=gaussians), np.ones(len(scene), bool), points if gone else ())
    colors = color_from_dc(added.sh_dc)
    assert len(colors) > 500
    assert (colors[:, 2] > colors[:, 0]).any() != gone


def test_a_window_through_which_other_photos_see_the_sky_stays_open():
    sides = [np.array([2.0, y, z]) for y in (-4.0, 4.0) for z in (1.5, 4.0)]
    cameras = [replace(CAMERA, world_from_camera=look_at(eye, np.array([6.0, 0.0, 1.5]))) for eye in sides]
    scene, _ = make_wall(views=tuple(CameraView(camera, f"side_{i}", 0, 0.0) for i, camera in enumerate(cameras)))
    added, _ = close_wall(scene, np.ones(len(scene), bool))
    assert not (np.abs(added.means[:, 1:] - [0, 1.5]).max(axis=1) < 0.7).any()
