"""Point clouds: LAS and LAZ by laspy, PCD in three forms, .ply without splats; sizes, colours, and files that lie."""

import sys

import laspy
import numpy as np
import pytest

from instdrive_core.errors import DataError
from instdrive_core.extras import MissingExtraError
from instdrive_core.formats.clouds.lzf import decompress_lzf
from instdrive_core.formats.clouds.sample_files import build_pcd
from instdrive_core.formats.registry import open_scene
from instdrive_core.maths.spherical_harmonics import color_from_dc

CORNER = np.array([652_100.0, 5_412_300.0, 410.0])


def cloud(count=500):
    return np.random.default_rng(0).uniform(0, 20, (count, 3))


def write_las(path, points, colors=None, **columns):
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = np.floor(points.min(axis=0)), [0.001] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    if colors is not None:
        data.red, data.green, data.blue = colors.T
    for name, values in columns.items():
        data[name] = values
    data.write(str(path))
    return path


@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_positions_far_away_keep_their_millimetres(tmp_path, ending):
    points, classes = cloud() + CORNER, np.arange(500) % 7
    scene = open_scene(write_las(tmp_path / f"a{ending}", points, classification=classes))
    np.testing.assert_allclose(scene.gaussians.means + scene.origin, points, atol=0.001)
    np.testing.assert_array_equal(scene.extra["classification"], classes)
    assert np.abs(scene.gaussians.means).max() < 30


@pytest.mark.parametrize("bits", [8, 16])
def test_colours_of_8_and_16_bits(tmp_path, bits):
    colors = np.random.default_rng(1).integers(1, 255, (500, 3))
    scene = open_scene(write_las(tmp_path / "a.las", cloud(), colors << (bits - 8)))
    np.testing.assert_allclose(color_from_dc(scene.gaussians.sh_dc), colors / 255, atol=1e-6)


def test_without_colours_intensity_is_grey(tmp_path):
    scene = open_scene(write_las(tmp_path / "a.las", cloud(), intensity=np.arange(500) * 100))
    greys = color_from_dc(scene.gaussians.sh_dc)
    assert (np.ptp(greys, axis=1) < 1e-6).all()
    assert (np.diff(greys[:, 0]) >= -1e-6).all()
    assert (greys[0, 0], greys[-1, 0]) == pytest.approx((0, 1), abs=1e-5)


def test_splats_are_as_large_as_the_gaps(tmp_path):
    near, far = np.mgrid[0:10, 0:10, 0:1].reshape(3, -1).T * 0.02, np.mgrid[0:10, 0:10, 0:1].reshape(3, -1).T * 0.2
    scene = open_scene(write_las(tmp_path / "a.las", np.r_[near, far + 50.0]))
    sizes = np.exp(scene.gaussians.log_scales[:, 0])
    assert np.median(sizes[:100]) == pytest.approx(0.008, rel=0.1)
    assert np.median(sizes[100:]) == pytest.approx(0.08, rel=0.1)


@pytest.mark.parametrize("form", ["ascii", "binary", "binary_compressed"])
def test_every_form_of_pcd(tmp_path, form):
    points, colors = cloud().astype(np.float32), np.random.default_rng(1).integers(0, 255, (500, 3))
    (tmp_path / "a.pcd").write_bytes(build_pcd(points, colors, form))
    scene = open_scene(tmp_path / "a.pcd")
    np.testing.assert_allclose(scene.gaussians.means, points, atol=0 if form != "ascii" else 1e-5)
    np.testing.assert_allclose(color_from_dc(scene.gaussians.sh_dc), colors / 255, atol=1e-6)


def test_points_without_a_position_are_left_out_and_told(tmp_path):
    points = cloud().astype(np.float32)
    points[::10, 1], points[5::10, 2] = np.nan, 3e38
    (tmp_path / "a.pcd").write_bytes(build_pcd(points, np.zeros((500, 3), int), "binary"))
    scene = open_scene(tmp_path / "a.pcd")
    assert len(scene) == 400
    assert scene.left_out == ("100 points without a position",)


def test_lzf_copies_from_what_it_has_written():
    packed = np.array([2, 7, 8, 9, 0b11100000, 3, 2, 0, 5], np.uint8)  # 3 literals, 12 bytes from 3 back, a literal
    out, written = decompress_lzf(packed, 16)
    assert written == 16
    assert out.tolist() == [7, 8, 9] * 5 + [5]
    assert decompress_lzf(np.array([0b00100000, 0], np.uint8), 3)[1] == -1  # from before the beginning
    assert decompress_lzf(packed, 10)[1] == -1


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"POINTS 500", b"POINTS 900", "do not fit"),
        (b"HEIGHT 1", b"HEIGHT x", "HEIGHT is 'x'"),
        (b"DATA binary", b"DATA gzip", "DATA is 'gzip'"),
        (b"FIELDS x y z", b"FIELDS x y q", "no z"),
        (b"SIZE 4 4", b"SIZE 4 3", "values of 3 F"),
        (b"SIZE 4 4", b"SIZE 4 " + b"4" * 5000, "values of 4444"),
        (b"WIDTH 500\nHEIGHT 1\nPOINTS 500", b"WIDTH 9000000\nHEIGHT 1\nPOINTS 9000000", "its points need"),
    ],
)
def test_headers_that_lie_are_refused(tmp_path, old, new, said):
    content = build_pcd(cloud().astype(np.float32), np.zeros((500, 3), int), "binary")
    assert old in content
    (tmp_path / "a.pcd").write_bytes(content.replace(old, new))
    with pytest.raises(DataError, match=said):
        open_scene(tmp_path / "a.pcd")


def test_a_header_that_ends_early_is_refused(tmp_path):
    """Version 1.3 promises fields that the file's bytes end before."""
    path = write_las(tmp_path / "a.las", cloud())
    whole = path.read_bytes()
    for end in range(200, 380, 9):
        path.write_bytes(whole[:end])
        with pytest.raises(DataError):
            open_scene(path)


def test_a_count_that_no_file_can_hold_is_refused(tmp_path):
    for ending, place in ((".las", 107), (".laz", 107)):
        path = write_las(tmp_path / f"a{ending}", cloud())
        content = bytearray(path.read_bytes())
        content[place : place + 4] = (2_000_000_000).to_bytes(4, "little")
        path.write_bytes(content)
        with pytest.raises(DataError, match="promises 2000000000 points"):
            open_scene(path)


def test_a_ply_of_bare_points_is_a_cloud(tmp_path):
    lines = ["ply", "format ascii 1.0", "element vertex 2", "property double x", "property double y"]
    lines += ["property double z", "property uchar red", "property uchar green", "property uchar blue", "end_header"]
    (tmp_path / "a.ply").write_text("\n".join([*lines, "1 2 3 255 0 51", "4 5 6 0 255 102", ""]))
    scene = open_scene(tmp_path / "a.ply")
    np.testing.assert_array_equal(scene.gaussians.means, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(color_from_dc(scene.gaussians.sh_dc), [[1, 0, 0.2], [0, 1, 0.4]], atol=1e-6)


def test_without_the_extra_its_name_is_told(tmp_path, monkeypatch):
    path = write_las(tmp_path / "a.las", cloud())
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(MissingExtraError, match=r"instdrive\[clouds\]"):
        open_scene(path)
