"""StreetGaussians' .ply of many elements: the same scene as the run's checkpoint, and objects are never piled up."""

import itertools

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from instdrive_core.cli.convert import convert
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError
from instdrive_core.formats.actors.sample_files import write_street_ply, write_street_run, write_street_tracks
from instdrive_core.formats.checkpoints.sample_files import (
    build_splat_arrays,
    build_street_content,
    write_checkpoint,
    write_training_folder,
)
from instdrive_core.formats.registry import open_scene

PLY = "point_cloud/iteration_9/point_cloud.ply"


@pytest.fixture
def content():
    """Background, an object with a track and two without, of another SH degree."""
    rng = np.random.default_rng(4)
    content = build_street_content(rng)
    for name, count in (("obj_003", 9), ("obj_012", 5)):
        arrays = build_splat_arrays(rng, count, rest=0)
        content[name] = {
            "xyz": arrays["means"],
            "feature_dc": rng.normal(0, 1, (count, 2, 3)).astype(np.float32),
            "feature_rest": arrays["rest"],
            "scaling": arrays["scales"],
            "rotation": arrays["quats"],
            "opacity": arrays["opacities"],
            "semantic": np.zeros((count, 1), np.float32),
        }
    return content


def assert_equal_scenes(found, expected):
    for name, array in expected.gaussians.arrays().items():
        np.testing.assert_allclose(getattr(found.gaussians, name), array, atol=1e-6, err_msg=name)
    np.testing.assert_array_equal(found.instance_ids, expected.instance_ids)
    np.testing.assert_array_equal(found.nodes, expected.nodes)
    assert [instance.name for instance in found.table] == [instance.name for instance in expected.table]
    for mine, theirs in zip(found.actors, expected.actors, strict=True):
        assert (mine.id, mine.label) == (theirs.id, theirs.label)
        np.testing.assert_array_equal(mine.world_from_box, theirs.world_from_box)


@pytest.mark.parametrize("order", ["<", ">", "="])
def test_it_holds_what_the_checkpoint_of_the_run_holds(tmp_path, content, order):
    run = tmp_path / "run"
    path = write_street_ply(run / PLY, content, order)
    checkpoint = write_checkpoint(run / "trained_model" / "iteration_9.pth", content)
    write_street_tracks(run)
    for options in ({}, {"time": 0.1}, {"keep_every": 3}):
        assert_equal_scenes(open_scene(path, **options), open_scene(checkpoint, **options))
    scene = open_scene(path)
    assert [instance.name for instance in scene.table] == ["obj_003", "obj_012", "obj_007"]
    assert [track.id for track in scene.actors] == ["obj_007"]
    assert any("the sky" in sentence and "iteration_9.pth" in sentence for sentence in scene.left_out)
    assert any("obj_003, obj_012" in sentence and "no box of them" in sentence for sentence in scene.left_out)


def test_columns_are_those_that_plyfile_reads(tmp_path, content):
    """The object's constant colour at its first frame is that of its series there: cosines 1, sines 0."""
    path = write_street_ply(tmp_path / "a.ply", content)
    write_street_tracks(tmp_path)
    table = next(element for element in PlyData.read(str(path)).elements if element.name == "vertex_obj_007")
    series = np.stack([table[f"f_dc_{column}"] for column in range(15)], axis=1).reshape(-1, 3, 5)
    scene = open_scene(path, time=0)
    rows = scene.instance_ids == 3
    np.testing.assert_allclose(scene.gaussians.sh_dc[rows], series[:, :, ::2].sum(axis=2), atol=1e-5)
    still = freeze_at_time(scene, 0)
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    places = np.stack([table[axis] for axis in "xyz"], axis=1) @ turn.T + [-3 + 8, 0, 0.5]
    np.testing.assert_allclose(still.gaussians.means[still.instance_ids == 3], places, atol=1e-4)


def test_objects_without_tracks_lie_side_by_side(tmp_path, content):
    scene = open_scene(write_street_ply(tmp_path / "a.ply", content))
    assert not scene.actors
    assert len(scene.table) == 3
    middles = []
    for instance in scene.table:
        own = scene.gaussians.means[scene.instance_ids == instance.id]
        lower, upper = np.percentile(own, [3, 97], axis=0)
        middles.append((lower[0], upper[0]))
        np.testing.assert_allclose((lower + upper)[1:] / 2, [0, 10], atol=1e-4)
    assert all(first[1] < second[0] for first, second in itertools.pairwise(middles))
    assert any("tracks of 3 moving objects" in sentence and "--data FOLDER" in sentence for sentence in scene.left_out)


def test_tracks_come_from_the_folder_that_is_given_or_that_the_run_names(tmp_path, content, capsys):
    path = write_street_ply(tmp_path / "home" / "out" / "run" / PLY, content)
    write_street_tracks(tmp_path / "data" / "002", frames=6)
    assert open_scene(path, data=tmp_path / "data" / "002").actors[0].times.tolist() == pytest.approx(
        [0, 0.1, 0.2, 0.3, 0.4, 0.5]
    )
    convert(path, tmp_path / "run_folder", data=tmp_path / "data" / "002")
    assert "corrections of the objects' tracks" in capsys.readouterr().out
    assert len(open_scene(tmp_path / "run_folder").actors) == 1
    write_street_run(tmp_path / "home" / "out" / "run", tmp_path / "data" / "002", frames=(2, 4))
    assert open_scene(path).actors[0].times.tolist() == pytest.approx([0.2, 0.3, 0.4])
    with pytest.raises(DataError, match=r"it holds no track/track_info\.txt"):
        open_scene(path, data=tmp_path)


def test_the_folder_of_a_run_opens_with_its_cameras(tmp_path, content):
    run = write_training_folder(tmp_path / "run", lambda path: write_street_ply(path, content))
    scene = open_scene(run)
    assert len(scene.views) == 3
    assert len(scene.table) == 3
    assert any("tracks of 3 moving objects" in sentence for sentence in scene.left_out)


def test_what_is_no_part_of_a_street_is_named(tmp_path, content):
    path = write_street_ply(tmp_path / "a.ply", content, "=")
    write_street_tracks(tmp_path)
    whole = PlyData.read(str(path))
    other = PlyElement.describe(np.zeros(3, [("red", "u1")]), "palette")
    for text in (True, False):
        PlyData([whole.elements[0], other, *whole.elements[1:]], text=text).write(str(tmp_path / "b.ply"))
        scene = open_scene(tmp_path / "b.ply")
        assert_equal_scenes(scene, open_scene(path))
        assert any("'palette'" in sentence for sentence in scene.left_out)


def test_a_sky_of_splats_is_an_instance(tmp_path, content):
    content["sky"] = content.pop("obj_003")
    scene = open_scene(write_street_ply(tmp_path / "a.ply", content))
    sky = next(instance for instance in scene.table if instance.name == "sky")
    np.testing.assert_array_equal(scene.gaussians.means[scene.instance_ids == sky.id], content["sky"]["xyz"])


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (b"vertex_obj_012", b"vertex_obj_003", "'vertex_obj_003' stands twice"),
        (b"property float f_dc_14", b"property float g_dc_14", "14 f_dc columns are not as many"),
        (b"element vertex_obj_012 5", b"element vertex_obj_012 7", "promises 7 splats"),
        (b"property float opacity", b"property float ooacity", "the columns opacity are missing"),
    ],
)
def test_damaged_headers_are_named(tmp_path, content, old, new, problem):
    path = write_street_ply(tmp_path / "a.ply", content)
    path.write_bytes(path.read_bytes().replace(old, new))
    with pytest.raises(DataError, match=problem):
        open_scene(path)


@pytest.mark.parametrize("value", ["inf", "nan", "9e300", "1e12", "much"])
def test_poses_that_are_none_are_named(tmp_path, content, value):
    path = write_street_ply(tmp_path / "a.ply", content)
    write_street_tracks(tmp_path)
    for row in (0, 3):  # of the rotation, and of the place
        numbers = np.eye(4).astype(str).ravel().tolist()
        numbers[row] = value
        (tmp_path / "ego_pose" / "000001.txt").write_text(" ".join(numbers))
        with pytest.raises(DataError, match=r"000001\.txt: is no pose of 4 x 4 numbers"):
            open_scene(path)
