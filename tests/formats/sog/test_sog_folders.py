"""SOG folders and levels of detail that the program writes: what replaces what, and what each level holds."""

import json

import numpy as np
import pytest
from random_scene import random_gaussians

from instdrive_core.formats.read_back import save_and_verify
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.sog import level_writing
from instdrive_core.formats.sog.levels import read_sog_folder
from instdrive_core.formats.sog.writing import bound_position_error
from instdrive_core.scene.scene import scene_from_gaussians


def street(count, seed=0):
    return scene_from_gaussians(random_gaussians(np.random.default_rng(seed), count, 1))


@pytest.fixture
def small_places(monkeypatch):
    monkeypatch.setattr(level_writing, "PLACE", 60)
    monkeypatch.setattr(level_writing, "FILE", 150)


def list_leaves(node):
    return [node] if "lods" in node else [leaf for child in node["children"] for leaf in list_leaves(child)]


def test_a_folder_holds_what_an_archive_does(tmp_path):
    save_scene(tmp_path / "a.sog", street(300))
    save_scene(tmp_path / "a" / "meta.json", street(300))
    archive, folder = open_scene(tmp_path / "a.sog"), open_scene(tmp_path / "a")
    for name, values in archive.gaussians.arrays().items():
        np.testing.assert_array_equal(getattr(folder.gaussians, name), values)


@pytest.mark.parametrize("name", ["meta.json", "lod-meta.json"])
def test_a_second_scene_leaves_nothing_of_the_first(tmp_path, name):
    save_scene(tmp_path / "a" / name, street(300))
    kept = tmp_path / "a" / "photo.webp"
    kept.write_bytes(b"the user's")
    save_scene(tmp_path / "a" / name, street(200, seed=1))
    found = {path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file()}
    save_scene(tmp_path / "b" / name, street(200, seed=1))
    alone = {path.relative_to(tmp_path / "b") for path in (tmp_path / "b").rglob("*") if path.is_file()}
    assert found == alone | {kept.relative_to(tmp_path / "a")}
    assert len(open_scene(tmp_path / "a" / name)) == 200


@pytest.mark.usefixtures("small_places")
def test_every_level_covers_every_place(tmp_path):
    scene = street(1000)
    save_and_verify(tmp_path / "lod-meta.json", scene)
    content = json.loads((tmp_path / "lod-meta.json").read_text())
    leaves = list_leaves(content["tree"])
    assert len(leaves) > 10
    assert len(content["filenames"]) > level_writing.LEVELS
    for level in range(level_writing.LEVELS):
        shown = read_sog_folder(tmp_path, level)
        assert len(shown) == content["counts"][level] == sum(leaf["lods"][str(level)]["count"] for leaf in leaves)
    assert content["counts"][0] == 1000
    assert content["counts"][1] < 300


@pytest.mark.usefixtures("small_places")
def test_the_finest_level_is_the_scene(tmp_path):
    scene = street(1000)
    save_scene(tmp_path / "lod-meta.json", scene)
    order = level_writing.order_for_levels(scene.gaussians.means)
    assert sorted(order) == list(range(1000))
    means, found = scene.gaussians.means[order], open_scene(tmp_path).gaussians
    assert (np.abs(found.means - means) <= bound_position_error(means)).all()
    np.testing.assert_allclose(found.opacities, scene.gaussians.opacities[order], atol=1 / 500)


@pytest.mark.usefixtures("small_places")
def test_bounds_hold_the_splats_of_all_levels(tmp_path):
    save_scene(tmp_path / "lod-meta.json", street(400))
    content = json.loads((tmp_path / "lod-meta.json").read_text())
    for leaf in list_leaves(content["tree"]):
        for entry in leaf["lods"].values():
            chunk = open_scene(tmp_path / content["filenames"][entry["file"]]).gaussians
            means = chunk.means[entry["offset"] : entry["offset"] + entry["count"]]
            assert (means >= np.array(leaf["bound"]["min"]) - 1e-3).all()
            assert (means <= np.array(leaf["bound"]["max"]) + 1e-3).all()


def test_coarser_levels_have_larger_splats(tmp_path):
    save_scene(tmp_path / "lod-meta.json", street(2000))
    sizes = [np.median(read_sog_folder(tmp_path, level).gaussians.log_scales.max(axis=1)) for level in range(3)]
    assert sizes[0] + 0.5 < sizes[1] < sizes[2] - 0.5
