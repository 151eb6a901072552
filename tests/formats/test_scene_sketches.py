"""Sketches: some splats of all over a large scene, read before the scene itself."""

import dataclasses

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.available_memory import VARIABLE
from instdrive_core.formats.ply import sketch as ply_sketch
from instdrive_core.formats.registry import save_scene, sketch_scene
from instdrive_core.formats.sog.levels import LOD_META, read_sog_folder

COUNT, MOST = 4000, 400


@pytest.fixture(scope="module")
def scene():
    return dataclasses.replace(random_scene(3, COUNT, actors=0), sky=None, views=())


def find_rows(scene, sketch):
    """Rows of the scene that the sketch shows; each splat of it must be one of the scene's."""
    places = {mean.tobytes(): row for row, mean in enumerate(scene.gaussians.means)}
    return np.array([places[mean.tobytes()] for mean in sketch.gaussians.means])


def test_a_sketch_of_a_ply_is_of_all_over_it_and_covers_what_all_do(scene, tmp_path):
    save_scene(tmp_path / "street.ply", scene)
    sketch = sketch_scene(tmp_path / "street.ply", MOST)
    rows = find_rows(scene, sketch)
    assert len(np.unique(rows)) == MOST
    assert np.histogram(rows, 10, (0, COUNT))[0].tolist() == [40] * 10, "evenly"
    np.testing.assert_array_equal(sketch.instance_ids, scene.instance_ids[rows])
    np.testing.assert_array_equal(sketch.gaussians.sh_rest, scene.gaussians.sh_rest[rows])
    growth = np.sort(sketch.gaussians.log_scales - scene.gaussians.log_scales[rows], axis=1)
    np.testing.assert_allclose(growth, np.tile([0, np.log(10) / 2, np.log(10) / 2], (MOST, 1)), atol=1e-5)


def test_a_slow_disk_gives_fewer_and_larger_splats_of_all_over_it(scene, tmp_path, monkeypatch):
    save_scene(tmp_path / "street.ply", scene)
    monkeypatch.setattr(ply_sketch, "SECONDS", -1.0)
    sketch = sketch_scene(tmp_path / "street.ply", MOST)
    rows = find_rows(scene, sketch)
    assert len(rows) == 28, "one pass of sixteen"
    assert (np.histogram(rows, 7, (0, COUNT))[0] > 0).all()
    growth = (sketch.gaussians.log_scales - scene.gaussians.log_scales[rows]).max(axis=1)
    np.testing.assert_allclose(growth, np.log(COUNT / 28) / 2, atol=0.01)


def test_a_sketch_of_levels_of_detail_is_a_coarse_level(scene, tmp_path):
    save_scene(tmp_path / LOD_META, scene)
    for path in (tmp_path, tmp_path / LOD_META):
        sketch = sketch_scene(path, MOST)
        wanted = read_sog_folder(tmp_path, level=2)
        assert len(sketch) == COUNT / 16
        np.testing.assert_array_equal(sketch.gaussians.means, wanted.gaussians.means)


@pytest.mark.parametrize("name", ["street.ply", LOD_META])
def test_small_scenes_have_no_sketch(scene, tmp_path, name):
    save_scene(tmp_path / name, scene)
    assert sketch_scene(tmp_path / name, COUNT) is None


def test_what_cannot_be_opened_has_no_sketch(scene, tmp_path, monkeypatch):
    path = tmp_path / "street.ply"
    assert sketch_scene(path, MOST) is None
    save_scene(path, scene)
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    assert sketch_scene(path, MOST) is None
    path.write_bytes(b"ply\n" + whole[len(whole) // 2 :])
    assert sketch_scene(path, MOST) is None
    path.write_bytes(whole)
    assert sketch_scene(path, MOST) is not None
    monkeypatch.setenv(VARIABLE, "1e-6")
    assert sketch_scene(path, MOST) is None, "there is not the memory for the scene"
