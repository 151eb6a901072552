"""HUGSIM's exported scenes: the ground is there, and what moves is an instance with its track."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError
from instdrive_core.files.torch_checkpoint import open_torch_checkpoint
from instdrive_core.formats.checkpoints.sample_files import write_checkpoint, write_hugsim_scene
from instdrive_core.formats.registry import open_scene
from instdrive_core.formats.scene_files import list_scene_files


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "scene-0383"
    folder.mkdir()
    return write_hugsim_scene(folder, np.random.default_rng(5))


def read_object(folder, name):
    file = open_torch_checkpoint(folder / f"dynamic_{name}.pth")
    names = ("degree", "xyz", "dc", "rest", "features", "scales", "quats", "opacity")
    found = dict(zip(names, file.content[0], strict=False))
    return {name: file.find_tensor(found[name]).read() for name in names[1:]}


def test_objects_are_where_hugsim_draws_them(folder):
    """The fitted motion, in the words of HUGSIM's renderer, by scipy: extrinsic turns about x, z, y."""
    scene = open_scene(folder)
    assert len(scene) == 30 + 12 + 6 + 14 + 9
    assert [instance.name for instance in scene.table] == ["object 3", "object 1", "object 2"]
    assert [track.id for track in scene.actors] == ["object 1", "object 2"]
    own = read_object(folder, "1")
    for row, yaw in enumerate(np.linspace(0.2, 0.9, 5)):
        time = row / 2
        turn = Rotation.from_euler("xzy", [0, 0, np.pi / 2 - yaw])
        still = freeze_at_time(scene, time)
        rows = still.instance_ids == 2
        places = turn.apply(own["xyz"]) + np.array([8 * time, 1.5, 20 - 3 * time])
        np.testing.assert_allclose(still.gaussians.means[rows], places, atol=1e-4)
        mine = Rotation.from_quat(still.gaussians.quats[rows], scalar_first=True)
        theirs = turn * Rotation.from_quat(own["quats"], scalar_first=True)
        np.testing.assert_allclose(mine.as_matrix(), theirs.as_matrix(), atol=1e-5)
    # Colours are in the world's axes; they are right in the middle of the track, and at the time asked for.
    for time, options in ((1.0, {}), (2.0, {"time": 2.0})):
        still = freeze_at_time(open_scene(folder, **options), time)
        np.testing.assert_allclose(still.gaussians.sh_rest[still.instance_ids == 2], own["rest"], atol=1e-4)


def test_boxes_stand_upright_and_look_ahead(folder):
    first, second = open_scene(folder).actors
    np.testing.assert_allclose(first.dimensions, [1.8, 4.4, 1.6], atol=1e-6)
    np.testing.assert_allclose(second.dimensions, [1.8, 4.4, 1.6], atol=1e-6)
    assert second.times.tolist() == [0.5, 1, 1.5, 2]
    pose = second.world_from_box[0]
    # It drives towards -z, in a world whose y points down; its box stands on its origin.
    np.testing.assert_allclose(pose[:3, 1], [0, 0, -1], atol=1e-6)
    np.testing.assert_allclose(pose[:3, 2], [0, -1, 0], atol=1e-6)
    np.testing.assert_allclose(pose[:3, 3], [-3, 1.4 - 0.8, 9], atol=1e-6)
    for track in (first, second):
        np.testing.assert_allclose(np.linalg.det(track.world_from_box[:, :3, :3]), 1, atol=1e-6)


def test_the_ground_is_read(folder):
    scene = open_scene(folder / "scene.pth")
    ground = scene.gaussians.log_scales[30:42]
    np.testing.assert_allclose(ground[:, 1], np.log(0.001), atol=1e-6)
    assert (scene.instance_ids[:42] == 0).all()


def test_what_has_no_track_lies_above_the_street(folder):
    scene = open_scene(folder)
    lower, upper = np.percentile(scene.gaussians.means[scene.instance_ids == 1], [3, 97], axis=0)
    np.testing.assert_allclose((lower + upper)[1:] / 2, [-10, 0], atol=1e-4)
    assert any(sentence.startswith("tracks of 1 moving objects") for sentence in scene.left_out)
    (folder / "meta_data.json").unlink()
    assert [track.id for track in open_scene(folder).actors] == ["object 1"]


def test_one_object_opens_by_itself(folder):
    scene = open_scene(folder / "dynamic_2.pth")
    np.testing.assert_array_equal(scene.gaussians.means, read_object(folder, "2")["xyz"])
    assert not scene.actors


def test_all_files_of_the_folder_are_listed(folder):
    names = {file.name for file in list_scene_files(folder)}
    assert names == {"scene.pth", "unicycle_1.pth", "meta_data.json", *(f"dynamic_{row}.pth" for row in (1, 2, 3))}


def test_damaged_files_are_named(folder):
    meta = json.loads((folder / "meta_data.json").read_text())
    meta["frames"][2]["dynamics"]["2"] = [[1, 2, 3, 4]] * 4
    (folder / "meta_data.json").write_text(json.dumps(meta))
    with pytest.raises(DataError, match=r"meta_data\.json: frames\[2\]\.dynamics\['2'\] is no pose"):
        open_scene(folder)
    times = np.array([0, 1, 1], np.float32)
    write_checkpoint(folder / "unicycle_1.pth", (times, times, times, np.zeros((3, 2), "f4"), times, times, times))
    write_checkpoint(folder / "dynamic_2.pth", {"weights": times})
    meta["frames"][2]["dynamics"] = {}
    (folder / "meta_data.json").write_text(json.dumps(meta))
    with pytest.raises(DataError, match=r"unicycle_1\.pth: its times do not rise"):
        open_scene(folder)
    (folder / "unicycle_1.pth").unlink()
    with pytest.raises(DataError, match=r"dynamic_2\.pth: it holds no Gaussians of HUGSIM"):
        open_scene(folder)
