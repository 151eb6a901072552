"""A scene with an actor, a sky and hidden splats as the editor shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from little_scenes import plain_splats, small_camera

from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.rasterize.kernels.sky_behind import render_sky_behind
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.gaussians import Gaussians, create_empty_gaussians
from instdrive_core.scene.scene import Scene, scene_from_gaussians
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track

CAMERA = small_camera()
SEEN_AT = (18, 26)


def street() -> Scene:
    """A red background splat in the middle of the view and, from 1 s to 3 s, a green actor that crosses before it."""
    background = plain_splats(CAMERA, [[26, 18]], [6.0], 6, 0.95)
    actor_at = plain_splats(CAMERA, [[26, 18]], [3.0], 6, 0.95).means[0]
    means = np.concatenate([background.means, [[0.1, 0.2, 0.0]]]).astype(np.float32)
    colors = np.array([[1, 0, 0], [0, 1, 0]], np.float32)
    gaussians = Gaussians(
        means,
        np.tile(np.array([1, 0, 0, 0], np.float32), (2, 1)),
        np.full((2, 3), np.log(0.4), np.float32),
        logit(np.full(2, 0.95, np.float32)),
        dc_from_color(colors),
        np.zeros((2, 0, 3), np.float32),
        np.zeros((2, 0), np.float32),
    )
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = actor_at - means[1] + np.array([[0, -50, 0], [0, 0, 0], [0, 50, 0]])
    track = Track("a", "car", np.array([2.0, 4.0, 1.5]), np.array([1.0, 2.0, 3.0]), poses, moving=True)
    return Scene(
        gaussians,
        np.array([7, 9], np.uint32),
        np.zeros(2, np.uint32),
        np.array([0, 1], np.uint16),
        actors=(track,),
        sky=Sky(np.full((6, 4, 4, 3), 0.25, np.float32)),
    )


def test_actors_are_where_their_track_puts_them_and_only_then() -> None:
    scene = street()
    shown = {time: view_scene(scene, CAMERA, time) for time in (0.0, 1.0, 2.0)}
    for time, instance in ((0.0, 7), (1.0, 7), (2.0, 9)):
        assert build_instance_map(scene, shown[time])[SEEN_AT] == instance, time
    assert shown[2.0].color[SEEN_AT][1] > 0.8
    assert shown[0.0].color[SEEN_AT][0] > 0.8
    np.testing.assert_array_equal(shown[0.0].winner == 1, False)


def test_a_photo_shows_actors_where_they_are_when_it_is_taken() -> None:
    scene = street()
    early = PhotoLag.look_from(np.zeros(3), 0.0, 2.0, 0.0, 0.0)
    place = scene.actors[0].interpolate_position(3.0)
    taken = 2.0 - 3.0 - early.find(place)  # so that the photo of step 3 shows the actor as it is at 2 s
    photo = replace(CAMERA, lag=replace(early, taken=taken))
    assert build_instance_map(scene, view_scene(scene, photo, 3.0))[SEEN_AT] == 9
    assert build_instance_map(scene, view_scene(scene, CAMERA, 3.0))[SEEN_AT] == 7


def test_the_sky_fills_what_the_gaussians_leave() -> None:
    scene = street()
    frame = view_scene(scene, CAMERA, 0.0)
    np.testing.assert_allclose(frame.color[0, 0], 0.25, atol=1e-6)
    assert build_instance_map(scene, frame)[0, 0] == 0
    blue = frame.color[..., 2]
    np.testing.assert_allclose(blue, 0.25 * (1 - frame.alpha), atol=1e-5)
    scene.sky = None
    assert not view_scene(scene, CAMERA, 0.0).color[0, 0].any()


def test_the_sky_is_looked_up_along_each_pixels_ray() -> None:
    scene = street()
    scene.sky = Sky(np.random.default_rng(0).uniform(size=(6, 8, 8, 3)).astype(np.float32))
    alpha = np.random.default_rng(1).uniform(size=(37, 53)).astype(np.float32)
    expected = scene.sky.sample(CAMERA.compute_ray_directions()) * (1 - alpha)[..., None]
    np.testing.assert_allclose(
        render_sky_behind(scene.sky, CAMERA, alpha), expected, atol=1e-3
    )  # nearly opaque: skipped


def test_hidden_splats_are_neither_drawn_nor_picked() -> None:
    scene = street()
    frame = view_scene(scene, CAMERA, 2.0, drawn=np.array([True, False]))
    assert frame.winner[SEEN_AT] == 0
    assert frame.color[SEEN_AT][1] == pytest.approx(0.25 * (1 - frame.alpha[SEEN_AT]), abs=1e-5)


def test_an_empty_scene_is_drawn() -> None:
    scene = scene_from_gaussians(create_empty_gaussians())
    frame = view_scene(scene, CAMERA, 0.0)
    assert not frame.color.any()
    assert not build_instance_map(scene, frame).any()
