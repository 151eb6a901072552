"""The .ply reader and writer against plyfile, an independent implementation."""

import contextlib
import dataclasses
import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement
from random_scene import assert_same_scene, random_scene

from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError
from instdrive_core.files.ply_header import MAX_COLUMNS
from instdrive_core.formats.ply import inria, row_scatter
from instdrive_core.formats.ply.inria import read_ply, write_ply
from instdrive_core.scene.scene import Scene, scene_from_gaussians

INRIA_ORDER = (
    ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    + [f"f_rest_{index}" for index in range(45)]
    + ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
)


def static_scene(**options):
    """A random scene that a .ply can hold whole: no actors, sky or views."""
    return dataclasses.replace(random_scene(actors=0, **options), sky=None, views=())


def vertices(scene):
    """The columns of a scene as plyfile takes them."""
    gaussians = scene.gaussians
    columns = dict(zip("xyz", gaussians.means.T, strict=True))
    columns |= {f"f_dc_{channel}": gaussians.sh_dc[:, channel] for channel in range(3)}
    rest = gaussians.sh_rest.transpose(0, 2, 1).reshape(len(scene), -1)
    columns |= {f"f_rest_{index}": rest[:, index] for index in range(rest.shape[1])}
    columns |= {"opacity": gaussians.opacity_logits}
    columns |= {f"scale_{axis}": gaussians.log_scales[:, axis] for axis in range(3)}
    columns |= {f"rot_{axis}": gaussians.quats[:, axis] for axis in range(4)}
    columns |= {f"feature_{index}": gaussians.features[:, index] for index in range(gaussians.features.shape[1])}
    return columns | {"instance_id": scene.instance_ids, "codeword": scene.codewords} | scene.extra


def write_by_plyfile(path, columns, text=False, order="<"):
    rows = np.empty(len(columns["x"]), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    PlyData([PlyElement.describe(rows, "vertex")], text=text, byte_order=order).write(str(path))


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("count", [0, 1, 200, 10_000])
def test_round_trip_keeps_every_bit(tmp_path, degree, count):
    scene = static_scene(degree=degree, count=count)
    scene.gaussians.opacity_logits[:4] = [np.inf, -np.inf, np.nan, -0.0][:count]
    write_ply(tmp_path / "a.ply", scene)
    again = read_ply(tmp_path / "a.ply")
    if count:
        assert_same_scene(again, scene)
    else:
        assert len(again) == 0
    write_ply(tmp_path / "b.ply", again)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_plyfile_reads_what_we_write(tmp_path):
    scene = static_scene()
    write_ply(tmp_path / "a.ply", scene)
    ply = PlyData.read(str(tmp_path / "a.ply"))
    names = [entry.name for entry in ply["vertex"].properties]
    assert names[: len(INRIA_ORDER)] == INRIA_ORDER
    assert names[len(INRIA_ORDER) :][:2] == ["instance_id", "codeword"]
    for name, column in vertices(scene).items():
        assert ply["vertex"][name].dtype == column.dtype, name
        np.testing.assert_array_equal(ply["vertex"][name], column, err_msg=name)
    assert not ply["vertex"]["nx"].any()


def test_a_scene_without_instances_stays_a_plain_inria_file(tmp_path):
    scene = static_scene(features=0)
    write_ply(tmp_path / "a.ply", scene_from_gaussians(scene.gaussians))
    header = (tmp_path / "a.ply").read_bytes().partition(b"end_header")[0].decode().splitlines()
    assert header[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 200"]
    assert [line.split()[-1] for line in header[3:]] == INRIA_ORDER


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.randoms(use_true_random=False), st.sampled_from(["<", ">", "text"]), st.booleans(), st.integers(0, 3))
def test_any_order_type_and_encoding_is_read(tmp_path, random, encoding, doubles, degree):
    scene = static_scene(count=30, degree=degree)
    columns = list(vertices(scene).items())
    random.shuffle(columns)
    types = {"instance_id": np.int32, "codeword": np.float64}
    if doubles:
        types |= {name: np.float64 for name, _ in columns if name not in types and name != "confidence"}
    converted = {name: column.astype(types.get(name, column.dtype)) for name, column in columns}
    write_by_plyfile(tmp_path / "a.ply", converted, encoding == "text", "=" if encoding == "text" else encoding)
    again = read_ply(tmp_path / "a.ply")
    for name, array in scene.gaussians.arrays().items():
        # plyfile prints 18 digits, which come back as the same float32.
        np.testing.assert_array_equal(getattr(again.gaussians, name), array, err_msg=name)
    np.testing.assert_array_equal(again.instance_ids, scene.instance_ids)
    np.testing.assert_array_equal(again.codewords, scene.codewords)
    np.testing.assert_array_equal(again.extra["confidence"], scene.extra["confidence"])


def test_unknown_columns_and_real_normals_are_kept(tmp_path):
    scene = static_scene(count=50)
    columns = vertices(scene)
    columns |= {"nx": np.zeros(50, np.float32), "ny": np.ones(50, np.float32), "nz": np.zeros(50, np.float32)}
    columns |= {"label": np.arange(50, dtype=np.uint8), "time": np.linspace(0, 1, 50)}
    write_by_plyfile(tmp_path / "a.ply", columns)
    write_ply(tmp_path / "b.ply", read_ply(tmp_path / "a.ply"))
    again = PlyData.read(str(tmp_path / "b.ply"))["vertex"]
    for name, column in columns.items():
        assert again[name].dtype == column.dtype
        np.testing.assert_array_equal(again[name], column, err_msg=name)


def test_elements_around_the_vertices_are_passed_over(tmp_path):
    scene = static_scene(count=20)
    rows = np.empty(20, [(name, column.dtype) for name, column in vertices(scene).items()])
    for name, column in vertices(scene).items():
        rows[name] = column
    camera = PlyElement.describe(np.array([(1.0, 2)], [("fx", "f8"), ("id", "u1")]), "camera")
    faces = np.empty(2, [("vertex_indices", object)])
    faces["vertex_indices"] = [np.arange(3, dtype=np.int32)] * 2
    elements = [camera, PlyElement.describe(rows, "vertex"), PlyElement.describe(faces, "face")]
    for text in (False, True):
        PlyData(elements, text=text).write(str(tmp_path / "a.ply"))
        np.testing.assert_array_equal(read_ply(tmp_path / "a.ply").gaussians.means, scene.gaussians.means)


def test_faces_before_the_vertices_are_passed_over_in_text(tmp_path):
    scene = static_scene(count=5)
    rows = np.empty(5, [(name, column.dtype) for name, column in vertices(scene).items()])
    for name, column in vertices(scene).items():
        rows[name] = column
    faces = np.empty(400, [("vertex_indices", object)])
    faces["vertex_indices"] = [np.arange(length % 5, dtype=np.int32) for length in range(400)]
    elements = [PlyElement.describe(faces, "face"), PlyElement.describe(rows, "vertex")]
    PlyData(elements, text=True).write(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(read_ply(tmp_path / "a.ply").gaussians.means, scene.gaussians.means)
    PlyData(elements, text=False).write(str(tmp_path / "b.ply"))
    with pytest.raises(DataError, match="lists stand before the vertices"):
        read_ply(tmp_path / "b.ply")


def test_many_short_rows_before_few_vertices_are_believed(tmp_path):
    times = PlyElement.describe(np.array([(1,)] * 3000, [("t", "u1")]), "time")
    columns = vertices(static_scene(count=2))
    rows = np.empty(2, [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    PlyData([times, PlyElement.describe(rows, "vertex")], text=True).write(str(tmp_path / "a.ply"))
    assert len(read_ply(tmp_path / "a.ply")) == 2


def test_names_classes_bits_and_origin_travel_in_comments(tmp_path):
    scene = static_scene()
    write_ply(tmp_path / "a.ply", scene)
    header = (tmp_path / "a.ply").read_bytes().partition(b"end_header")[0]
    assert header.isascii()
    again = read_ply(tmp_path / "a.ply")
    assert again.table[1].name == "parked – “taxi”"
    assert again.table[2].name == "a b\\n"
    assert again.table[1].class_name == "Car"
    assert again.code_bits == scene.code_bits
    np.testing.assert_array_equal(again.origin, scene.origin)


def test_moving_actors_must_be_placed_first(tmp_path):
    scene = random_scene(actors=2)
    with pytest.raises(DataError, match="--time"):
        write_ply(tmp_path / "a.ply", scene)
    assert list(tmp_path.iterdir()) == []
    write_ply(tmp_path / "a.ply", freeze_at_time(scene, 0.1))


# Real files


@pytest.mark.parametrize(("name", "count"), [("train-1000.ply", 1000), ("fruit_drops_minimal.ply", 4721)])
def test_files_of_other_programs(splat_files, tmp_path, name, count):
    scene = read_ply(splat_files / name)
    theirs = PlyData.read(str(splat_files / name))["vertex"]
    assert len(scene) == len(theirs.data) == count
    assert scene.gaussians.sh_degree == 3
    write_ply(tmp_path / name, scene)
    ours = PlyData.read(str(tmp_path / name))["vertex"]
    for entry in theirs.properties:
        assert ours[entry.name].tobytes() == theirs[entry.name].tobytes(), entry.name
    assert (np.linalg.norm(scene.gaussians.quats, axis=1) > 0).all()


def test_a_packed_file_opens_under_the_plain_ending_too(splat_files, tmp_path):
    (tmp_path / "biker.ply").symlink_to(splat_files / "biker.compressed.ply")
    assert len(read_ply(tmp_path / "biker.ply")) == 152746


# Files that are wrong


@pytest.fixture
def plain(tmp_path):
    path = tmp_path / "plain.ply"
    write_ply(path, static_scene(count=20, degree=1))
    return path


def changed(path, old, new):
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"ply\n", b"pli\n", "does not begin"),
        (b"binary_little_endian 1.0", b"binary_little_endian 2.0", "not understood"),
        (b"format binary_little_endian 1.0\n", b"", "no format"),
        (b"element vertex 20", b"element vertex 21", "promises 21"),
        (b"element vertex 20", b"element vertex 19", "follow the 19"),
        (b"element vertex 20", b"element vertex 999999999999999999999", "promises 9"),
        (b"element vertex 20", b"element vertex " + b"9" * 5000, "not understood"),
        (b"element vertex 20", b"element vertex -20", "not understood"),
        (b"element vertex 20", b"element a 0\n" * 257 + b"element vertex 20", "more than 256 elements"),
        (b"element vertex 20", b"element point 20", "no vertex element"),
        (b"element vertex 20", b"property float early\nelement vertex 20", "not understood"),
        (b"property float x", b"property float32x x", "not understood"),
        (b"property float y", b"property float x", "twice"),
        (b"property float x", b"property list uchar float x", "list"),
        (b"property float opacity", b"property float density", "opacity are missing"),
        (b"property float f_rest_8", b"property float other", "8 f_rest columns"),
        (b"property float f_rest_4", b"property float f_rest_9", "f_rest_4 is missing"),
        (b"property float feature_1", b"property float feature_7", "feature_1 is missing"),
        (b"end_header\n", b"", "end_header"),
        (b'{"code_bits"', b'{"code_bats"', "damaged"),
        (b'{"code_bits":4', b'{"code_bits":4e9', "damaged"),
        (b'{"code_bits":4', b'{"code_bits":1e999', "damaged"),
        (b'{"id":1', b'["id":1', "damaged"),
    ],
)
def test_wrong_headers_are_explained(plain, old, new, message):
    with pytest.raises(DataError, match=message) as caught:
        read_ply(changed(plain, old, new))
    assert str(plain) in str(caught.value)


def test_headers_of_thousands_of_columns_are_refused(tmp_path):
    columns = "".join(f"property float c{number}\n" for number in range(MAX_COLUMNS + 1))
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex 0\n{columns}end_header\n"
    (tmp_path / "a.ply").write_text(header)
    with pytest.raises(DataError, match="more than 4,096 properties"):
        read_ply(tmp_path / "a.ply")


@pytest.mark.parametrize("before", ["", "element note 1\nproperty list uint uchar letters\n"])
def test_endless_lines_take_no_memory(tmp_path, before):
    columns = vertices(static_scene(count=1, degree=0, features=0))
    write_by_plyfile(tmp_path / "a.ply", columns, text=True)
    content = (tmp_path / "a.ply").read_bytes().replace(b"element vertex", before.encode() + b"element vertex")
    header, row = content.split(b"end_header\n")
    (tmp_path / "a.ply").write_bytes(header + b"end_header\n" + b"0 " * 10_000_000 + b"\n" + row)
    tracemalloc.start()
    try:
        if before:
            assert len(read_ply(tmp_path / "a.ply")) == 1
        else:
            with pytest.raises(DataError, match="a line is longer than"):
                read_ply(tmp_path / "a.ply")
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def test_a_point_cloud_with_some_columns_of_splats_is_refused(tmp_path):
    write_by_plyfile(tmp_path / "a.ply", {name: np.zeros(3, np.float32) for name in ("x", "y", "z", "opacity")})
    with pytest.raises(DataError, match="of 3D Gaussians or of bare points"):
        read_ply(tmp_path / "a.ply")


def test_flat_gaussians_are_recognised(tmp_path):
    columns = vertices(static_scene(count=3))
    del columns["scale_2"]
    write_by_plyfile(tmp_path / "a.ply", columns)
    with pytest.raises(DataError, match=r"a file of 2D Gaussians \(2DGS\)"):
        read_ply(tmp_path / "a.ply")


@pytest.mark.parametrize("wrong", [-1, 0.5, 2**24, np.nan])
def test_instance_ids_must_be_whole_and_in_range(tmp_path, wrong):
    columns = vertices(static_scene(count=5))
    columns["instance_id"] = np.array([0, 1, wrong, 2, 3], np.float64)
    write_by_plyfile(tmp_path / "a.ply", columns)
    with pytest.raises(DataError, match="instance_id"):
        read_ply(tmp_path / "a.ply")


@pytest.mark.parametrize(("old", "new"), [(b"\n1.5 ", b"\none "), (b"\n1.5 ", b"\n1.5 7 "), (b"\n1.5 ", b"\n\n")])
def test_wrong_ascii_lines_are_explained(tmp_path, old, new):
    columns = vertices(static_scene(count=5, degree=0))
    columns["x"] = np.full(5, 1.5, np.float32)
    write_by_plyfile(tmp_path / "a.ply", columns, text=True)
    with pytest.raises(DataError):
        read_ply(changed(tmp_path / "a.ply", old, new))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_damaged_files_open_or_explain_themselves(tmp_path, data):
    path = tmp_path / "plain.ply"
    write_ply(path, static_scene(count=3, degree=0, features=0))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(content) - 1))
        match data.draw(st.sampled_from(["flip", "cut", "insert", "drop"])):
            case "flip":
                content[place] = data.draw(st.integers(0, 255))
            case "cut":
                del content[place + 1 :]
            case "insert":
                content[place:place] = data.draw(st.binary(min_size=1, max_size=9))
            case "drop":
                del content[place : place + data.draw(st.integers(1, 9))]
        content = content or bytearray(b"p")
    path.write_bytes(content)
    # Any other error, and any warning, fails.
    with contextlib.suppress(DataError):
        assert isinstance(read_ply(path), Scene)


@pytest.fixture
def threads_read_all(monkeypatch):
    """Files of any size are read by threads, in several blocks."""
    monkeypatch.setattr(row_scatter, "LEAST_ROWS", 1)
    monkeypatch.setattr(row_scatter, "BLOCK_ROWS", 50)


def test_threads_read_the_same(tmp_path, monkeypatch, threads_read_all):
    scene = static_scene(seed=4, count=333)
    columns = vertices(scene) | {"confidence": np.arange(333, dtype=np.float32)}
    write_by_plyfile(tmp_path / "street.ply", dict(reversed(columns.items())))
    by_threads = read_ply(tmp_path / "street.ply")
    monkeypatch.setattr(row_scatter, "LEAST_ROWS", 1000)
    assert_same_scene(by_threads, read_ply(tmp_path / "street.ply"))
    np.testing.assert_array_equal(by_threads.gaussians.sh_rest, scene.gaussians.sh_rest)
    np.testing.assert_array_equal(by_threads.extra["confidence"], columns["confidence"])


def test_threads_tell_of_ids_that_are_none(tmp_path, threads_read_all):
    columns = vertices(static_scene(seed=4, count=333))
    columns["instance_id"] = columns["instance_id"].astype(np.float32)
    columns["instance_id"][200] = 1.5
    write_by_plyfile(tmp_path / "street.ply", columns)
    with pytest.raises(DataError, match=r"column 'instance_id' holds 1\.5, not a whole number"):
        read_ply(tmp_path / "street.ply")
    columns["instance_id"] = np.full(333, 1 << 24, np.uint32)
    write_by_plyfile(tmp_path / "street.ply", columns)
    with pytest.raises(DataError, match="column 'instance_id' holds 16777216"):
        read_ply(tmp_path / "street.ply")


def test_threads_tell_where_a_file_breaks_off(tmp_path, monkeypatch, threads_read_all):
    """It is cut while it is read: before that the header's count would have told."""
    path = tmp_path / "street.ply"
    write_by_plyfile(path, vertices(static_scene(seed=4, count=333)))
    whole = path.read_bytes()

    def cut(path, header, *arrays):
        path.write_bytes(whole[: header.body_offset + 120 * header.dtype.itemsize])
        row_scatter.scatter_rows(path, header, *arrays)

    monkeypatch.setattr(inria, "scatter_rows", cut)
    with pytest.raises(DataError, match="the file ends after 120 of 333 splats"):
        read_ply(path)
