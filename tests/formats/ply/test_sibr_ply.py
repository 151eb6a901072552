"""The .ply twin for SIBR viewers, read as they read it: by a fixed record, and by plyfile."""

import dataclasses
import struct

import numpy as np
import pytest
from plyfile import PlyData
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.errors import DataError
from instdrive_core.formats.registry import open_scene, save_scene

RECORD = struct.Struct("<3f3f48f1f3f4f")
"""Position, normal, SH of degree 3, opacity, scale, rotation."""


def read_as_a_viewer(path):
    """What a viewer with a fixed record takes from a file: it looks at the third line, and at nothing else it says."""
    with path.open("rb") as file:
        assert file.readline() == b"ply\n"
        assert file.readline() == b"format binary_little_endian 1.0\n"
        element, vertex, count = file.readline().split()
        assert (element, vertex) == (b"element", b"vertex")
        lines = 0
        while file.readline() != b"end_header\n":
            lines += 1
        assert lines == 62
        body = file.read()
    assert len(body) == int(count) * RECORD.size
    return np.array(list(RECORD.iter_unpack(body)), np.float32).reshape(int(count), 62)


def placed_scene(**options):
    """Instances, features, an unknown column and an origin, but no moving actors."""
    return random_scene(actors=0, **options)


@pytest.mark.parametrize("degree", range(4))
def test_every_value_stands_where_a_fixed_record_expects_it(tmp_path, degree):
    # More rows than are converted at a time.
    scene = placed_scene(degree=degree, count=9000)
    save_scene(tmp_path / "a.sibr.ply", scene)
    records, gaussians = read_as_a_viewer(tmp_path / "a.sibr.ply"), scene.gaussians
    np.testing.assert_array_equal(records[:, :3], gaussians.means)
    assert not records[:, 3:6].any()
    np.testing.assert_array_equal(records[:, 6:9], gaussians.sh_dc)
    expected = np.zeros((len(scene), 15, 3), np.float32)
    expected[:, : gaussians.sh_rest.shape[1]] = gaussians.sh_rest
    for channel in range(3):
        np.testing.assert_array_equal(records[:, 9 + 15 * channel : 24 + 15 * channel], expected[:, :, channel])
    np.testing.assert_array_equal(records[:, 54], gaussians.opacity_logits)
    np.testing.assert_array_equal(records[:, 55:58], gaussians.log_scales)
    np.testing.assert_array_equal(records[:, 58:], gaussians.quats)


def test_plyfile_finds_the_named_columns_and_no_others(tmp_path):
    scene = placed_scene()
    save_scene(tmp_path / "a.sibr.ply", scene)
    ply = PlyData.read(str(tmp_path / "a.sibr.ply"))
    assert not ply.comments
    assert [element.name for element in ply.elements] == ["vertex"]
    vertex = ply["vertex"]
    names = [entry.name for entry in vertex.properties]
    assert names[:9] == ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    assert names[9:54] == [f"f_rest_{index}" for index in range(45)]
    assert names[54:] == ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    np.testing.assert_array_equal(vertex["f_rest_16"], scene.gaussians.sh_rest[:, 1, 1])
    np.testing.assert_array_equal(vertex["rot_0"], scene.gaussians.quats[:, 0])


def test_the_gaussians_come_back_bit_by_bit(tmp_path):
    scene = placed_scene()
    scene.gaussians.opacity_logits[:3] = [np.inf, -np.inf, np.nan]
    save_scene(tmp_path / "a.sibr.ply", scene)
    again = open_scene(tmp_path / "a.sibr.ply")
    for name, array in scene.gaussians.arrays().items():
        if name != "features":
            assert getattr(again.gaussians, name).tobytes() == array.tobytes(), name
    assert not again.extra
    assert not len(again.table)
    save_scene(tmp_path / "empty.sibr.ply", placed_scene(count=0))
    assert len(read_as_a_viewer(tmp_path / "empty.sibr.ply")) == 0


def test_the_option_gives_the_same_file_under_the_name_that_viewers_look_for(tmp_path, capsys):
    save_scene(tmp_path / "run", random_scene(degree=1))
    named, plain = tmp_path / "a.sibr.ply", tmp_path / "point_cloud.ply"
    assert main(["convert", str(tmp_path / "run"), str(named), "--time", "0.3"]) == 0
    assert main(["convert", str(tmp_path / "run"), str(plain), "--time", "0.3", "--sibr"]) == 0
    assert named.read_bytes() == plain.read_bytes()
    text = capsys.readouterr().out
    assert "8 instances" in text
    # Filled up with zeros, not lost.
    assert "SH degree" not in text
    assert main(["apply", str(tmp_path / "run"), "--time", "0.3", "--sibr", "-o", str(tmp_path / "b.ply")]) == 0
    assert (tmp_path / "b.ply").read_bytes() == plain.read_bytes()
    assert main(["apply", str(tmp_path / "run"), "--delete", "1", "-o", str(tmp_path / "c.sibr.ply")]) == 0
    assert len(read_as_a_viewer(tmp_path / "c.sibr.ply")) < len(read_as_a_viewer(plain))


@pytest.mark.parametrize("name", ["a.splat", "a.compressed.ply", "folder"])
def test_only_a_plain_ply_can_be_a_twin(tmp_path, capsys, name):
    save_scene(tmp_path / "run", random_scene())
    assert main(["convert", str(tmp_path / "run"), str(tmp_path / name), "--sibr"]) == 2
    assert "ends in .ply" in capsys.readouterr().err
    assert not (tmp_path / name).exists()


def test_moving_actors_must_be_placed_first(tmp_path):
    with pytest.raises(DataError, match="--time"):
        save_scene(tmp_path / "a.sibr.ply", random_scene())
    scene = dataclasses.replace(placed_scene(), views=())
    save_scene(tmp_path / "a.ply", scene, sibr=True)
    assert len(read_as_a_viewer(tmp_path / "a.ply")) == len(scene)
