"""A .ply with a start view keeps camera and sky; a damaged comment is named, a missing picture is no error."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import procedural_street

from instdrive_core.edits.document.document import Document
from instdrive_core.errors import DataError
from instdrive_core.formats.ply.start_view import find_sky_path
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.project.export import export_scene
from instdrive_core.scene.sky import Sky


@pytest.fixture
def exported(tmp_path):
    """The street with noise as its sky, exported, and the camera it was looked at from."""
    scene = procedural_street(0.5)
    scene.sky = Sky(np.random.default_rng(3).random((6, 8, 8, 3)).astype(np.float32))
    path, start = tmp_path / "street.ply", scene.views[1].camera
    export_scene(Document(scene), path, 0.0, start=start)
    return path, start, scene.sky


def test_view_and_sky_come_back(exported):
    path, start, sky = exported
    found = open_scene(path)
    np.testing.assert_array_equal(found.start.world_from_camera, start.world_from_camera)
    assert (found.start.fx, found.start.width) == (start.fx, start.width)
    np.testing.assert_allclose(found.sky.faces, sky.faces, atol=0.5 / 255 + 1e-6)


def test_without_its_picture_a_file_opens_without_a_sky(exported):
    path, _, _ = exported
    find_sky_path(path).write_bytes(b"no picture")
    assert open_scene(path).sky is None
    find_sky_path(path).unlink()
    found = open_scene(path)
    assert found.sky is None
    assert found.start is not None


def test_a_damaged_view_is_named(exported):
    path, _, _ = exported
    data = path.read_bytes()
    path.write_bytes(data.replace(b'"width":', b'"wodth":', 1))
    with pytest.raises(DataError, match="instdrive view"):
        open_scene(path)


def test_scenes_that_nobody_looked_at_stay_plain(tmp_path):
    save_scene(tmp_path / "plain.ply", replace(procedural_street(0.5), actors=(), nodes=_no_nodes()))
    assert [path.name for path in tmp_path.iterdir()] == ["plain.ply"]
    assert b"instdrive view" not in (tmp_path / "plain.ply").read_bytes()


def _no_nodes():
    return np.zeros(len(procedural_street(0.5)), np.uint16)
