"""INRIA's training folders open with the cameras of their photos."""

import json

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError
from instdrive_core.formats.checkpoints.sample_files import write_training_folder
from instdrive_core.formats.registry import open_scene, save_scene


@pytest.fixture
def folder(tmp_path):
    scene = freeze_at_time(random_scene(1, 20, actors=0), 0.0)
    return write_training_folder(tmp_path / "run", lambda path: save_scene(path, scene))


def test_the_newest_iteration_opens_with_its_cameras(folder, tmp_path):
    older = folder / "point_cloud" / "iteration_7000" / "point_cloud.ply"
    save_scene(older, random_scene(1, 5, actors=0))
    (tmp_path / "data" / "images").mkdir(parents=True)
    (tmp_path / "data" / "images" / "00001.jpg").write_bytes(b"photo")
    for path in (folder, folder / "cfg_args"):
        scene = open_scene(path)
        assert len(scene) == 20
        assert [view.photo for view in scene.views] == ["", str(tmp_path / "data" / "images" / "00001.jpg"), ""]
        camera = scene.views[1].camera
        assert (camera.fx, camera.fy, camera.cx, camera.width, camera.height) == (500, 505, 320, 640, 360)
        # What lies ahead of this camera, along the third column of its rotation, is in the middle of the picture.
        pixels, depth = camera.project(np.array([[1.0, 2.0 + 4, 3.5]]))
        np.testing.assert_allclose(pixels, [[320, 180]])
        assert depth == 4


def test_exposures_are_left_out_and_said(folder):
    (folder / "exposure.json").write_text("{}")
    assert open_scene(folder).left_out[0].startswith("exposures of the photos")


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("fx", 0, "no focal length"),
        ("width", 1e9, "no size of a photo"),
        ("position", [1, 2], "no place"),
        ("rotation", [[1, 0, 0], [0, 2, 0], [0, 0, 1]], "more than turn"),
        ("rotation", 3, "no matrix"),
        ("img_name", None, "is no text"),
        ("fy", None, "expected a number"),
    ],
)
def test_cameras_that_cannot_be_are_refused_by_field(folder, field, value, message):
    cameras = json.loads((folder / "cameras.json").read_text())
    cameras[2][field] = value
    (folder / "cameras.json").write_text(json.dumps(cameras))
    with pytest.raises(DataError, match=rf"cameras\.json: .*\[2\]\..*{message}"):
        open_scene(folder)


def test_names_of_photos_do_not_lead_out(folder, tmp_path):
    (tmp_path / "secret.jpg").write_bytes(b"x")
    (tmp_path / "data" / "images").mkdir(parents=True)
    cameras = json.loads((folder / "cameras.json").read_text())
    for camera, name in zip(cameras, ("../../secret.jpg", str(tmp_path / "secret"), "a\\b"), strict=True):
        camera["img_name"] = name
    (folder / "cameras.json").write_text(json.dumps(cameras))
    assert [view.photo for view in open_scene(folder).views] == ["", "", ""]


def test_a_folder_without_cameras_says_what_to_open(folder):
    (folder / "cameras.json").unlink()
    with pytest.raises(DataError, match=r"holds no cameras\.json\. Copy .*, or open its point_cloud\.ply"):
        open_scene(folder)
