"""Silhouettes of single things, against pictures of these things alone."""

import numpy as np
from random_scene import random_scene

from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.rasterize.silhouettes import measure_silhouettes


def test_a_silhouette_is_what_the_thing_alone_covers():
    scene = random_scene(count=300)
    scene.gaussians.log_scales[:] = -1.2
    scene.gaussians.opacity_logits[:] = 2
    ids = np.unique(scene.instance_ids).tolist()
    groups = np.array([ids.index(one) for one in scene.instance_ids], np.int32)
    view = scene.views[2]
    found = measure_silhouettes(scene, groups, len(ids), view.camera, view.time)
    assert (found.pixels > 20).sum() >= 3
    for place, one in enumerate(ids):
        alone = view_scene(scene, view.camera, view.time, drawn=scene.instance_ids == one).alpha >= 0.5
        assert abs(int(found.pixels[place]) - int(alone.sum())) <= 1 + 0.02 * alone.sum()
        if alone.sum() > 20:
            rows, columns = np.nonzero(alone)
            box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            assert np.abs(found.boxes[place] - box).max() <= 1


def test_groups_without_a_splat_in_view_are_empty():
    scene = random_scene(count=50)
    groups = np.full(50, -1, np.int32)
    found = measure_silhouettes(scene, groups, 3, scene.views[0].camera, 0.0)
    assert not found.pixels.any()
    assert not found.boxes.any()
