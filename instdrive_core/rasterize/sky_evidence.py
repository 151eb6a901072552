"""How much of the sky the photos of a scene saw, and a scene whose unseen sky is filled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from instdrive_core.rasterize.ground_color import find_ground_color
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky, find_cube_taps
from instdrive_core.scene.sky_fill import SkyEvidence, fill_unseen_sky

WIDTH = 200
"""Pixels across the pictures that evidence is taken from."""
MOST_VIEWS, FEWEST_VIEWS, FULL_COUNT = 24, 12, 200_000
"""Views that are looked through, fewer in scenes of more splats than the last number."""
_LEAST_WEIGHT = 0.1


def measure_sky_evidence(scene: Scene, resolution: int) -> SkyEvidence:
    """Measure how much light reaches the photos' cameras from each texel of a sky; find the ground's colour, too.

    Looks through evenly chosen cameras of the scene, at small pictures.
    """
    evidence = np.zeros(6 * resolution * resolution, np.float32)
    wanted = int(np.clip(MOST_VIEWS * FULL_COUNT / max(len(scene), 1), FEWEST_VIEWS, MOST_VIEWS))
    for view in choose_spread_views(scene.views, wanted):
        camera = view.camera.scale(min(1.0, WIDTH / view.camera.width))
        clear = (1 - view_scene(scene, camera, view.time).alpha).ravel()
        texels, weights = find_cube_taps(camera.compute_ray_directions().reshape(-1, 3), resolution)
        for tap in range(texels.shape[1]):
            near = weights[:, tap] > _LEAST_WEIGHT
            np.maximum.at(evidence, texels[near, tap], clear[near])
    faces = evidence.reshape(6, resolution, resolution)
    # Texels between the rays of two pixels were seen, too.
    light = np.clip(np.stack([ndimage.grey_closing(face, 3) for face in faces]), 0, 1)
    return SkyEvidence(light, find_ground_color(scene))


def choose_spread_views(views: Sequence[CameraView], wanted: int) -> list[CameraView]:
    """Choose about `wanted` views, as many of each camera, evenly over its times: not every k-th of all, which may be
    one camera's only, since those of a moment follow each other."""
    by_camera: dict[str, list[CameraView]] = {}
    for view in views:
        by_camera.setdefault(view.name, []).append(view)
    each = -(-wanted // max(len(by_camera), 1))
    chosen = []
    for mine in by_camera.values():
        places = np.linspace(0, len(mine) - 1, min(each, len(mine))).round().astype(int)
        chosen += [mine[place] for place in places.tolist()]
    return chosen


def fill_scene_sky(scene: Scene) -> Sky | None:
    """Fill what none of the scene's photos saw of its sky and below it; the sky itself where there are no cameras."""
    if scene.sky is None or not scene.views:
        return scene.sky
    return fill_unseen_sky(scene.sky, measure_sky_evidence(scene, scene.sky.faces.shape[1]))
