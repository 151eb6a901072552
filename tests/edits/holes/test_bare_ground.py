"""Deleting the car in front: what it hid in every photo is filled, and what photos saw stays."""

from copy import deepcopy

import numpy as np
import pytest
from parked_street import CAR, CAR_SIZE, ROAD, scene_of

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.instances.table import build_instance_table
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.track import Track

HOUSE = 40
GREY = (0.4, 0.4, 0.42)
AHEAD = 9.0
"""Metres from the camera to the middle of the car in front."""
TIMES = np.linspace(0.0, 1.0, 11)


def drive(hidden: bool):
    """A road that a camera follows another car on; it is bare where the car `hidden` it all the time."""
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.arange(-7, 7, 0.14), np.arange(-4, 36, 0.14))
    ground = np.c_[x.ravel(), y.ravel(), rng.normal(0, 0.004, x.size)]
    width = 0.9 + 0.12 * (ground[:, 1] - AHEAD - 6)
    bare = (np.abs(ground[:, 0]) < width) & (ground[:, 1] > AHEAD + 6) & hidden
    ground = ground[~bare]
    shell = rng.uniform(-0.5, 0.5, (3000, 3))
    axis = rng.integers(0, 3, len(shell))
    shell[np.arange(len(shell)), axis] = np.sign(shell[np.arange(len(shell)), axis]) / 2
    means = np.concatenate([ground, shell * CAR_SIZE])
    ids = np.repeat([ROAD, CAR], [len(ground), len(shell)])
    colors = np.where(ids[:, None] == ROAD, GREY, [0.7, 0.1, 0.1])
    views = []
    for index, time in enumerate(TIMES.tolist()):
        eye = np.array([0.0, 6 * time, 1.5])
        camera = Camera(300.0, 300.0, 200.0, 100.0, 400, 240, look_at(eye, eye + np.array([0, 10, -0.8])))
        views.append(CameraView(camera, "front_camera", index, time))
    scene = scene_of(rng, means, ids, colors, tuple(views))
    scene.nodes[ids == CAR] = 1
    poses = np.tile(np.eye(4), (len(TIMES), 1, 1))
    poses[:, :3, 3] = np.c_[np.zeros(len(TIMES)), AHEAD + 6 * TIMES, np.full(len(TIMES), CAR_SIZE[2] / 2)]
    scene.actors = (Track("car", "Car", CAR_SIZE, TIMES, poses, moving=True),)
    names, classes = {ROAD: "road", CAR: "Car 7"}, {CAR: "Car"}
    scene.table = build_instance_table(
        scene.instance_ids, scene.gaussians.means, scene.codewords, scene.nodes, names, classes
    )
    return scene


@pytest.fixture(scope="module")
def followed():
    return drive(hidden=True)


def test_ground_hidden_all_the_time_is_a_hole(followed):
    document = Document(deepcopy(followed))
    document.apply(DeleteInstances((CAR,)))
    report = report_deletion(document, (CAR,), 0.0)
    cells = np.concatenate([hole.grid.compute_centers(hole.cells) for hole in report.holes])
    assert np.mean(np.abs(cells[:, 0]) < 4) > 0.95
    assert cells[:, 1].min() > AHEAD + 5, "photos saw the rest once the car had driven on"
    assert cells[:, 1].max() > AHEAD + 15
    assert report.clearings[0].name == "Car 7"


def test_the_fill_closes_it_for_every_photo(followed):
    document = Document(deepcopy(followed))
    document.apply(DeleteInstances((CAR,)))
    gone = bake_document(document)
    for fill in report_deletion(document, (CAR,), 0.0).make_fill_edits():
        document.apply(fill)
    filled = bake_document(document)
    for view in followed.views[::5]:
        before, after = (view_scene(scene, view.camera, view.time) for scene in (gone, filled))
        beyond = np.zeros(before.alpha.shape, bool)
        beyond[90:120, 150:250] = True  # ground 10 to 30 m away
        assert (before.alpha[beyond] < 0.5).mean() > 0.03, "the sky shows through the road"
        assert (after.alpha[beyond] < 0.5).mean() < 0.01
        assert np.abs(after.color[beyond & (before.alpha < 0.5)] - GREY).mean() < 0.06


def test_ground_that_photos_saw_is_no_hole():
    document = Document(drive(hidden=False))
    document.apply(DeleteInstances((CAR,)))
    report = report_deletion(document, (CAR,), 0.0)
    assert report.hole_area < 1.0


def walk_along_a_house():
    """Somebody walks along a house in the picture of a camera that passes by; the wall has a gap behind."""
    rng = np.random.default_rng(4)
    x, y = np.meshgrid(np.arange(-4, 8, 0.14), np.arange(-14, 14, 0.14))
    ground = np.c_[x.ravel(), y.ravel(), rng.normal(0, 0.004, x.size)]
    y, z = np.meshgrid(np.arange(-14, 14, 0.14), np.arange(0, 5, 0.14))
    wall = np.c_[np.full(y.size, 8.0), y.ravel(), z.ravel()]
    wall = wall[(np.abs(wall[:, 1] - 0.8) > 0.5) | (wall[:, 2] > 1.5)]
    size = np.array([0.6, 0.8, 1.8])
    shell = rng.uniform(-0.5, 0.5, (1500, 3)) * size
    means = np.concatenate([ground, wall, shell])
    ids = np.repeat([ROAD, HOUSE, CAR], [len(ground), len(wall), len(shell)])
    colors = np.where(ids[:, None] == CAR, [0.7, 0.1, 0.1], np.where(ids[:, None] == HOUSE, (0.6, 0.5, 0.4), GREY))
    views, poses = [], np.tile(np.eye(4), (len(TIMES), 1, 1))
    for index, time in enumerate(TIMES.tolist()):
        eye = np.array([-3.0, time, 1.5])
        poses[index, :3, 3] = eye + (np.array([8.0, 0.8, 0.0]) - eye) * 0.9 + [0, 0, 0.9 - 0.15]
        camera = Camera(300.0, 300.0, 200.0, 120.0, 400, 240, look_at(eye, eye + np.array([10, 0, -0.8])))
        views.append(CameraView(camera, "left_camera", index, time))
    scene = scene_of(rng, means, ids, colors, tuple(views))
    scene.nodes[ids == CAR] = 1
    scene.actors = (Track("walker", "Pedestrian", size, TIMES, poses, moving=True),)
    names, classes = {ROAD: "road", HOUSE: "house", CAR: "Pedestrian 7"}, {CAR: "Pedestrian", HOUSE: "Building"}
    scene.table = build_instance_table(
        scene.instance_ids, scene.gaussians.means, scene.codewords, scene.nodes, names, classes
    )
    return scene


def test_nobody_looks_for_ground_behind_a_wall():
    document = Document(walk_along_a_house())
    document.apply(DeleteInstances((CAR,)))
    report = report_deletion(document, (CAR,), 0.0)
    cells = np.concatenate([np.zeros((0, 2)), *(hole.grid.compute_centers(hole.cells) for hole in report.holes)])
    assert not (cells[:, 0] > 10.5).any(), "2.5 m behind the wall"
