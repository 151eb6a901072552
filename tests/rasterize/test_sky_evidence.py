"""Only the sky that photos saw between the splats counts as seen."""

from dataclasses import replace

import numpy as np
from procedural_street import ROAD, procedural_street

from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.rasterize.ground_color import find_ground_color
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.rasterize.sky_evidence import choose_spread_views, fill_scene_sky, measure_sky_evidence
from instdrive_core.scene.sky import Sky, find_cube_taps


def test_evidence_is_where_a_camera_sees_past_the_splats():
    scene = procedural_street(0.5)
    evidence = measure_sky_evidence(scene, 64)
    flat = evidence.light.reshape(-1)

    def look(*direction):
        return flat[find_cube_taps(np.array([direction], np.float32), 64)[0][0]].max()

    ahead = scene.views[0].camera.world_from_camera[:3, 2]
    assert look(*(ahead + np.array([0, 0, 0.25]))) > 0.9
    assert look(*-ahead) < 0.01
    assert look(0.0, 0.0, -1.0) < 0.01


def test_where_no_photo_saw_the_ground_it_has_the_colour_of_the_road():
    scene = procedural_street(0.3)
    scene.sky = Sky(np.ones((6, 32, 32, 3), np.float32))
    road = color_from_dc(scene.gaussians.sh_dc[scene.instance_ids == ROAD])
    below = fill_scene_sky(scene).faces[5, 16, 16]
    np.testing.assert_allclose(below, np.median(road, axis=0), atol=0.05)


def test_splats_far_from_the_cameras_or_above_them_are_no_ground():
    scene = procedural_street(0.3)
    assert find_ground_color(scene) is not None

    def look_from(shift):
        views = []
        for view in scene.views:
            pose = view.camera.world_from_camera.copy()
            pose[:3, 3] += shift
            views.append(replace(view, camera=replace(view.camera, world_from_camera=pose)))
        return replace(scene, views=tuple(views))

    assert find_ground_color(look_from((0, 100, 0))) is None
    assert find_ground_color(look_from((0, 0, -2))) is None
    assert find_ground_color(replace(scene, views=())) is None


def test_broken_splats_are_no_ground():
    scene = procedural_street(0.3)
    plain = find_ground_color(scene)
    broken = np.flatnonzero(scene.instance_ids == ROAD)[:3]
    for row, column in zip(broken, ("means", "quats", "sh_dc"), strict=True):
        getattr(scene.gaussians, column)[row] = np.nan
    np.testing.assert_allclose(find_ground_color(scene), plain, atol=0.01)


def test_photos_see_the_same_as_before():
    scene = procedural_street()
    filled = replace(scene, sky=fill_scene_sky(scene))
    for view in scene.views[:2]:
        pictures = [view_scene(each, view.camera, view.time).color for each in (scene, filled)]
        assert np.mean((pictures[0] - pictures[1]) ** 2) < 10**-4.5


def test_noise_behind_the_cameras_is_filled_and_the_photos_views_keep_their_sky():
    scene = procedural_street(0.5)
    noise = np.random.default_rng(1).random((6, 32, 32, 3)).astype(np.float32)
    scene.sky = Sky(noise)
    filled = fill_scene_sky(scene).faces
    changed = np.abs(filled - noise).max(axis=-1) > 1e-6
    assert 0.5 < changed.mean() < 1
    nadir = filled[5]
    assert np.abs(np.diff(nadir, axis=0)).max() < 0.1


def test_every_camera_is_looked_through_also_where_those_of_a_moment_follow_each_other():
    view = procedural_street(0.5).views[0]
    names = [f"camera {number}" for number in range(6)]
    views = [replace(view, name=name, index=step, time=step / 10) for step in range(30) for name in names]
    chosen = choose_spread_views(views, 16)
    assert {one.name for one in chosen} == set(names)
    assert {one.index for one in chosen} >= {0, 29}
    assert 16 <= len(chosen) <= 24
    assert choose_spread_views(views[:1], 16) == views[:1]
    assert choose_spread_views((), 16) == []
